"""The controller keeps to the lateral acceleration up to which its prediction is valid."""

import json

import numpy as np
import pytest

from sidestep.controller import ControllerConfig, SteeringController
from sidestep.controller.mpc.car_model import Car, axle_force
from sidestep.controller.records import WORK, record
from sidestep.controller.settings import settings_of
from sidestep.controller.validity import Validity, slip_limits
from sidestep.plant_models import Line, Obstacle, ReferencePath, VehicleParameters, VehicleState
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.vehicle.parameters import GRAVITY

CAR = VehicleParameters.preset("bmw-320i")
TABLES = {
    "speed": [10.0, 20.0],
    "friction": [1.0, 0.5],
    "max_lateral_acceleration": {
        "affine": [[4.0, 3.0], [2.0, 1.0]],
        "linear": [[2.0, 1.0]] * 2,
        "euler": [[1.5, 2.5]] * 2,
    },
}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "validity.json"
    path.write_text(json.dumps(TABLES), encoding="utf-8")
    return str(path)


def test_limits_between_the_table_s_points(file):
    validity = Validity.from_file(file, "affine")
    assert validity.by_speed(1.0) == pytest.approx([4.0, 3.0])
    assert validity.by_speed(0.75) == pytest.approx([3.0, 2.0])
    assert validity.by_speed(0.1) == pytest.approx([2.0, 1.0])


def slip_at(speed, file, **settings):
    config = ControllerConfig(validity=file, slip_share=1.0, **settings)
    records, work = settings_of(CAR, config), record(WORK)
    slip_limits(speed, work[0], records[0])
    return work["slip_limits"][0].tolist()


@pytest.mark.parametrize(("affine", "model"), [(True, "affine"), (False, "linear")])
def test_slip_makes_the_force_of_that_acceleration(file, affine, model):
    car = Car.of(CAR, affine, 1.0)
    front, rear = slip_at(15.0, file, tyre_model=model)
    forces = axle_force(front, car.stiffness_f, car.load_f, car), axle_force(rear, car.stiffness_r, car.load_r, car)
    assert sum(forces) / CAR.mass == pytest.approx(3.5 if affine else 1.5, rel=2e-3)
    assert forces[0] / car.load_f == pytest.approx(forces[1] / car.load_r, rel=2e-3)


def test_what_the_tyres_never_reach_is_the_peak(file):
    icy = Car.of(CAR, True, 0.05)
    front, _ = slip_at(10.0, file, friction=0.05)
    assert axle_force(front, icy.stiffness_f, icy.load_f, icy) < 2.0 / GRAVITY * icy.load_f
    assert np.isfinite(front)


def test_the_plan_keeps_the_slip_angle_of_that_acceleration(file):
    path, box, largest = ReferencePath.from_segments([Line(200.0)]), Obstacle(28.0, -0.6, 4.5, 1.8), []
    for validity in ("", file):
        controller = SteeringController(CAR, path, [box], ControllerConfig(cruise_speed=20.0, validity=validity))
        controller.step(VehicleState(v_x=20.0))
        assert controller.plan is not None
        _, _, beta, yaw_rate, steer, _ = controller.plan.states.T
        largest.append(np.abs(steer - beta - CAR.l_f * yaw_rate / 20.0).max())
    bound, _ = slip_at(20.0, file)
    assert largest[0] > bound + 8e-4
    assert largest[1] < bound + 1e-4  # soft


def test_the_paper_s_angle_bound_follows_its_own_table(file):
    path = ReferencePath.from_segments([Line(200.0)])
    paper = SteeringController(CAR, path, [], ControllerConfig.preset("paper", validity=file))
    paper.step(VehicleState(v_x=15.0))
    assert paper.problem is not None
    assert paper.problem.x_u == pytest.approx(np.full(40, np.arctan(CAR.wheelbase * 1.5 / 15.0**2)))


def changed(**parts: object) -> str:
    return json.dumps(TABLES | parts)


def limits(rows: object) -> str:
    return changed(max_lateral_acceleration=TABLES["max_lateral_acceleration"] | {"affine": rows})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "Expecting value"),
        ("[]", "indices"),
        ("{}", "'speed'"),
        (changed(speed=[20.0, 10.0]), "speeds that do not rise"),
        (changed(speed=[10.0, 10.0]), "speeds that do not rise"),
        (changed(speed=[float("nan"), 20.0]), "speeds that do not rise"),
        (changed(speed=[10.0, float("nan")]), "speeds that do not rise"),
        (changed(speed=[10.0, float("inf")]), "speeds that do not rise"),
        (changed(speed=[-10.0, 20.0]), "speeds that do not rise"),
        (changed(friction=[1.0]), "shape"),
        (changed(friction=1.0, max_lateral_acceleration={"affine": [4.0, 3.0]}), "shape"),
        (changed(friction=[1.0, float("nan")]), "friction that is not positive"),
        (changed(friction=[1.0, 0.0]), "friction that is not positive"),
        (changed(friction=[1.0, 1.0]), "friction 1 stands in more than one row"),  # the laxer row won
        (limits([[4.0, -3.0], [2.0, 1.0]]), "negative or no number"),
        (limits([[4.0, float("nan")], [2.0, 1.0]]), "negative or no number"),
        (limits([]), "shape"),
        (changed(friction=1.0, speed=[[10.0, 20.0]], max_lateral_acceleration={"affine": [[4.0, 3.0]]}), "shape"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, text, reason):
    (tmp_path / "bad.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"(controller\.validity|bad\.json): .*{reason}"):
        Validity.of(ControllerConfig(validity=str(tmp_path / "bad.json")))
