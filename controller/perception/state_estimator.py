"""What the state estimator keeps, takes and works with: records of fixed size, as the step's own.

An extended Kalman filter on the controller's model of the car. Its states are those of VehicleState plus what the
model does not know. Sensors speak at their own rates and late: the filter keeps its last states in order of time; what
comes late is put where it belongs, and all that is newer is done again.
"""

import numpy as np

X, Y, YAW, V_X, V_Y, YAW_RATE, STEER, BIAS, ACTUATOR, SENSOR, SHARE = range(11)
"""States. World position [m], yaw [rad], velocity of the reference point [m/s], yaw rate [rad/s], road-wheel angle that
the tyres have [rad]; bias of the yaw-rate sensor [rad/s]; angle that the sensor shows less the commanded one, at rest
(`actuator`), and that the tyres have less what the sensor shows (`sensor`) [rad]; lateral force as a share of the
weight that no accelerometer feels: bank."""
STATES = 11
NAMES = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "steer_angle", "bias", "actuator", "sensor", "share")
"""Of the states."""
LATERAL = 7
"""Signal of the accelerometer; those before it show the state of the same number."""
SIGNALS = 8
SIGNAL_NAMES = (*NAMES[:LATERAL], "lateral_acceleration")
"""Of the signals."""
SLOTS = 64
"""Room for the records of the last half second, vehicle signals and late poses together: 128 a second."""

F, N, B = np.float64, np.int64, np.int8

MEASUREMENT = np.dtype([("time", F), ("pose_time", F), ("z", F, (SIGNALS,))], align=True)
"""What sensors say, NaN where they say nothing: signals `z` at `time`, of which x, y and yaw are of `pose_time` if that
is not NaN."""

SLOT = np.dtype(
    [
        ("time", F), ("z", F, (SIGNALS,)), ("verdict", B, (SIGNALS,)), ("command", F), ("acceleration", F),
        ("steer_rate", F), ("tangents", F, (4,)), ("lag", F), ("x", F, (STATES,)), ("P", F, (STATES, STATES)),
    ],
    align=True,
)  # fmt: skip
"""One record taken, what was thought of each of its signals, and state and covariance with it; road-wheel angle
commanded [rad] and change of v_x expected [m/s^2] from then on, NaN if nobody knows, and the rate at which the wheels
got there [rad/s]; slope [N/rad] and force at zero slip [N] of front and rear axle, lag of their forces [s]."""

ESTIMATE = np.dtype(
    [
        ("slots", SLOT, (SLOTS,)), ("first", N), ("count", N),
        ("misfits", N, (SIGNALS,)), ("rejected", N, (SIGNALS,)), ("too_late", N), ("unusable", N),
        ("innovation", F, (SIGNALS,)), ("innovation_variance", F, (SIGNALS,)), ("nis", F), ("degrees", N),
    ],
    align=True,
)  # fmt: skip
"""All that lasts: slots in order of time, from `first` on, round the end; misfits in a row and rejections of each
signal, records too late and unusable. Of the last record: innovations and their variances, NaN where nothing was
measured, their normalised square and its degrees of freedom."""

ESTIMATOR = np.dtype(
    [
        ("noise", F, (SIGNALS,)), ("walk", F, (STATES,)), ("free_steer", F), ("doubt", F), ("kinematic", F, (2,)),
        ("start", F, (STATES,)), ("gate", F, (2,)), ("patience", N), ("reach", F),
        ("least", F, (2,)), ("stiffness", F, (2,)), ("lever", F), ("steer_limit", F), ("blend", F, (2,)),
    ],
    align=True,
)  # fmt: skip
"""Settings that hold for a drive: standard deviation of each signal; of each state's random walk in a second, and of
the steering angle's where no command is known; of an axle force in a second, as a share of itself [sqrt(s)]; of v_y
[m/s] and yaw rate [rad/s] about the rolling car's at low speed; of each state at the start; chi-square gates of one and
two degrees; misfits in a row after which a sensor is believed; lateness that is still used [s]; least slopes of the
axle forces [N/rad]; slope of front and rear axle force over that of its tyres; accelerometer ahead of the reference
point [m]; speeds between which the rolling car becomes the sliding one [m/s]."""

FILTER = np.dtype(
    [
        ("transition", F, (STATES, STATES)), ("product", F, (STATES, STATES)), ("x", F, (STATES,)),
        ("noise", F, (STATES,)), ("row", F, (STATES,)), ("gain", F, (STATES,)), ("column", F, (STATES,)),
        ("mass", F, (2, 2)), ("jacobian", F, (2, 2)), ("force", F, (2,)), ("axle", F, (2,)),
        ("by_steer", F, (2,)), ("by_speed", F, (2,)),
    ],
    align=True,
)  # fmt: skip
"""Work space, nothing in it lasts: transition of the states, its product with P, state before, noise added; row of a
measurement, its gain and P times the row; mass times change of (v_y, yaw rate) = force, and its
derivatives by these two, steering angle and v_x; axle forces
[N]."""
