"""The state estimator on a measured car at its limits: sideslip that it never sees, beside what an optical sensor saw.

    python benchmarks/perception/measured_sideslip.py FILE.csv[.gz] [seconds]

Settings were developed on so many seconds from the first row. FILE is a 100 Hz log of a Ferrari 250 LM with the
columns time, road_wheel_angle, v_x, yaw_rate, a_y and sideslip, in SI units; sideslip is only compared with. Tyres and
yaw inertia were fitted to the axle forces (from a_y, yaw acceleration and measured slip) of the first 165 s of the
first half's log; what the filter believes was chosen by the error there.
"""

import sys

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.perception.estimator import EstimatorConfig, Measurement, StateEstimator
from sidestep.plant_models.tyres.parameters import TyreParameters
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]
TYRE = TyreParameters(
    nominal_load=2408.0, p_cy1=1.01, p_dy1=1.06, p_dy2=0.37, p_ey1=-1.29, p_ky1=18.0, p_ky2=0.0, relaxation_y=0.1
)
CAR = VehicleParameters.preset(
    "bmw-320i", mass=982.0, yaw_inertia=1160.0, l_f=1.33, l_r=1.07, length=4.1, width=1.7, tyre=TYRE
)
CONFIG = EstimatorConfig(
    v_x_noise=0.05, yaw_rate_noise=0.01, steer_noise=0.001, lateral_noise=2.0,  # bumps are not white
    v_x_walk=3.0, v_y_walk=0.6, yaw_rate_walk=0.1, force_doubt=0.0, free_steer_walk=0.3, share_walk=0.005,
    start_bias=0.005, start_offset=0.005,
    front_stiffness=0.92, rear_stiffness=1.24,
)  # fmt: skip
DEVELOPED = 165.0
"""Time that was looked at when these were chosen, in [s]."""


def columns(file: str) -> dict[str, Array]:
    """Columns by name, without their units."""
    table = np.genfromtxt(file, delimiter=",", names=True, deletechars="", replace_space=" ")
    return {name.split(" ")[0]: table[name] for name in table.dtype.names or ()}


def estimated(log: dict[str, Array]) -> tuple[Array, Array]:
    """Sideslip and its standard deviation at every row, in [rad]."""
    filtered, angles, deviations = StateEstimator(CAR, CONFIG), [], []
    signals = (log[name] for name in ("time", "v_x", "yaw_rate", "road_wheel_angle", "a_y"))
    for time, v_x, yaw_rate, steer, lateral in zip(*signals, strict=True):
        state = filtered.step(
            Measurement(time, v_x=v_x, yaw_rate=yaw_rate, steer_angle=steer, lateral_acceleration=lateral)
        )
        slope = np.array([-state.v_y, state.v_x]) / (state.v_x**2 + state.v_y**2)
        angles.append(np.arctan2(state.v_y, state.v_x))
        deviations.append(np.sqrt(slope @ filtered.covariance[3:5, 3:5] @ slope))
    print("left out:", {name: count for name, count in filtered.rejected.items() if count})
    return np.array(angles), np.array(deviations)


def report(name: str, errors: Array, deviations: Array) -> None:
    print(
        f"{name}: {len(errors)} rows, sideslip RMS error {np.degrees(np.sqrt(np.mean(errors**2))):.3f} deg,"
        f" largest {np.degrees(np.abs(errors).max()):.2f} deg, mean standard deviation"
        f" {np.degrees(deviations.mean()):.3f} deg,"
        f" within two of them {100 * np.mean(np.abs(errors) < 2 * deviations):.1f} %"
    )


def main(file: str, developed: float) -> None:
    log = columns(file)
    angles, deviations = estimated(log)
    errors = angles - log["sideslip"]
    early = log["time"] < log["time"][0] + developed
    for name, rows in (("developed on", early), ("judged on", ~early), ("all", early | ~early)):
        if rows.any():
            report(name, errors[rows], deviations[rows])


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else DEVELOPED)
