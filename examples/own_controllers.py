"""Controllers of your own in the loop, by name: Stanley, pure pursuit and a linear-quadratic regulator.

    sidestep run s-curve --set "obstacles=[]" --controller examples.own_controllers:Stanley

Each takes what it needs of `vehicle`, `path`, `obstacles`, `config` and `speed`, and answers a state with a road-wheel
angle. They follow the road's reference path and know nothing of obstacles. Ours steps beside them and takes over if one
fails. All four in one table: python examples/own_controllers.py
"""

from math import atan2, cos, sin

import numpy as np
from scipy.linalg import solve_discrete_are

from sidestep import ReferencePath, VehicleParameters, VehicleState, drive, load_scenario
from sidestep.plant_models.linear.bicycle import continuous, discretise


class PurePursuit:
    """The arc of the rear axle through a point of the path ahead (Coulter, CMU-RI-TR-92-01)."""

    def __init__(self, vehicle: VehicleParameters, path: ReferencePath, speed: float):
        self.car, self.path, self.ahead, self.s = vehicle, path, 3.0 + 0.6 * speed, None

    def reset(self) -> None:
        """Forget where the car was."""
        self.s = None

    def step(self, state: VehicleState) -> float:
        """The road-wheel angle, in [rad]."""
        x, y = state.x - self.car.l_r * cos(state.yaw), state.y - self.car.l_r * sin(state.yaw)
        self.s, _, _ = self.path.project(x, y, self.s)
        goal_x, goal_y = self.path.to_cartesian(self.s + self.ahead, 0.0)
        bearing = atan2(goal_y - y, goal_x - x) - state.yaw
        return atan2(2.0 * self.car.wheelbase * sin(bearing), np.hypot(goal_x - x, goal_y - y))


class Stanley:
    """Heading error and offset of the front axle (Hoffmann et al., ACC 2007), less the lead of its yaw rate."""

    def __init__(self, vehicle: VehicleParameters, path: ReferencePath):
        self.car, self.path, self.gain, self.s = vehicle, path, 2.5, None

    def reset(self) -> None:
        """Forget where the car was."""
        self.s = None

    def step(self, state: VehicleState) -> float:
        """The road-wheel angle, in [rad]."""
        x, y = state.x + self.car.l_f * cos(state.yaw), state.y + self.car.l_f * sin(state.yaw)
        self.s, offset, heading = self.path.project(x, y, self.s)
        error = heading - state.yaw
        wrapped = atan2(sin(error), cos(error))
        lead = self.path.curvature(self.s) * state.v_x - state.yaw_rate
        return wrapped + atan2(-self.gain * offset, 1.0 + state.v_x) + 0.05 * lead


class Lqr:
    """State feedback on offset, heading, sideslip and yaw rate of the linear bicycle, and the bend's steady angle."""

    def __init__(self, vehicle: VehicleParameters, path: ReferencePath, speed: float):
        a, b, _ = continuous(vehicle, speed)
        a, inputs = discretise(a, b[:, None], 0.02)
        cost = np.diag([1.0, 4.0, 0.0, 0.2])
        riccati = solve_discrete_are(a, inputs, cost, np.array([[40.0]]))
        self.gains = np.linalg.solve(40.0 + inputs.T @ riccati @ inputs, inputs.T @ riccati @ a)[0]
        self.car, self.path, self.speed, self.s = vehicle, path, speed, None

    def reset(self) -> None:
        """Forget where the car was."""
        self.s = None

    def step(self, state: VehicleState) -> float:
        """The road-wheel angle, in [rad]."""
        self.s, offset, heading = self.path.project(state.x, state.y, self.s)
        bend, car = self.path.curvature(self.s), self.car
        understeer = (
            car.mass
            * (car.l_r / car.cornering_stiffness_front - car.l_f / car.cornering_stiffness_rear)
            / car.wheelbase
        )
        steady = bend * (car.wheelbase + understeer * state.v_x**2)
        sideslip = bend * (car.l_r - car.mass * car.l_f * state.v_x**2 / (car.cornering_stiffness_rear * car.wheelbase))
        error = state.yaw - heading
        errors = (
            offset,
            atan2(sin(error), cos(error)) + sideslip,
            atan2(state.v_y, state.v_x) - sideslip,
            state.yaw_rate - bend * state.v_x,
        )
        return steady - float(self.gains @ errors)


HEADS = ("controller", "RMS offset [m]", "largest [m]", "max |a_y| [m/s²]", "max rate [deg/s]")


def main() -> None:
    print("  ".join(f"{head:>16}" for head in HEADS))
    for name in ("", "Stanley", "PurePursuit", "Lqr"):
        own = {"kind": f"examples.own_controllers:{name}"} if name else {}
        scene = load_scenario("s-curve", obstacles=[], start={"l": 0.5}, plant={"kind": "single-track"}, controller=own)
        run = drive(scene)
        figures = (
            run.summary["rms_lateral_error_m"], np.abs(run.recording["l"]).max(),
            run.summary["max_lateral_acceleration"], np.degrees(run.summary["max_steer_rate"]),
        )  # fmt: skip
        print("  ".join([f"{name or 'sidestep':>16}", *(f"{figure:16.3f}" for figure in figures)]))


if __name__ == "__main__":
    main()
