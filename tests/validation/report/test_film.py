"""Films of the MuJoCo car: what is drawn where, what is refused, and what the file holds."""

import math
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from PIL import Image

from sidestep.controller import SteeringController
from sidestep.plant_models.errors import InputError
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.plant_models.mujoco.plant import MujocoPlant
from sidestep.validation.cli.main import main
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.report import film as module
from sidestep.validation.report.film import Camera, film, write_film
from sidestep.validation.report.scene import draw_plan
from sidestep.validation.scenarios.scenario import load_scenario

SCENARIO = load_scenario("single-obstacle", ["duration=0.2"])


def lines(scene, colour):
    """Ends of the capsules of one colour, shape (n, 2, 3)."""
    ends = []
    for geom in scene.geoms[: scene.ngeom]:
        if np.allclose(geom.rgba, colour):
            half = geom.mat[:, 2] * geom.size[2]
            ends.append((geom.pos - half, geom.pos + half))
    return np.array(ends)


def test_road_corridor_plan_and_prediction_are_drawn_where_they_are():
    controller = SteeringController(SCENARIO.vehicle, SCENARIO.path, SCENARIO.obstacles, SCENARIO.controller)
    with open_plant(SCENARIO) as plant:
        assert isinstance(plant, MujocoPlant)
        state = plant.reset(SCENARIO.start)
        controller.step(state)
        scene = mujoco.MjvScene(plant.model, maxgeom=3000)
    draw_plan(scene, SCENARIO, controller.plan, state.x, state.y)
    plan, config = controller.plan, SCENARIO.controller
    edges = lines(scene, (0.9, 0.9, 0.9, 1.0))
    assert sorted(set(np.round(edges[..., 1].ravel(), 6))) == [-config.width_right, config.width_left]
    predicted = lines(scene, (1.0, 0.6, 0.0, 1.0))
    assert len(predicted) == len(plan.states) - 1
    assert predicted[-1, 1, :2] == pytest.approx([plan.states_s[-1], plan.states[-1, 0]], abs=1e-5)
    corridor = lines(scene, (0.1, 0.7, 0.3, 1.0))
    finite = [np.isfinite(side).sum() - 1 for side in (plan.left, plan.right)]
    assert len(corridor) == sum(finite)
    full = mujoco.MjvScene(plant.model, maxgeom=10)
    draw_plan(full, SCENARIO, None, state.x, state.y)
    assert full.ngeom == 10


def test_a_gif_holds_the_frames_at_their_rate(tmp_path):
    frames = [np.full((54, 96, 3), shade, np.uint8) for shade in (0, 100, 200)]
    write_film(tmp_path / "film.gif", frames)
    with Image.open(tmp_path / "film.gif") as image:
        assert (image.n_frames, image.info["duration"], image.size[0]) == (3, 50, 640)
    write_film(tmp_path / "none.gif", [])
    assert not (tmp_path / "none.gif").exists()


def test_an_mp4_is_made_by_ffmpeg(tmp_path, monkeypatch):
    calls = []

    def run(command, **rest):
        calls.append((command, rest))
        Path(command[-1]).write_bytes(b"film")

    monkeypatch.setattr(module, "_ffmpeg", lambda: "ffmpeg")
    monkeypatch.setattr(module.subprocess, "run", run)
    write_film(tmp_path / "film.mp4", [np.zeros((4, 6, 3), np.uint8)] * 2)
    (command, rest) = calls[0]
    assert command[-1].endswith(".mp4")
    assert (tmp_path / "film.mp4").read_bytes() == b"film"
    assert command[command.index("-s") + 1] == "6x4"
    assert len(rest["input"]) == 2 * 4 * 6 * 3


@pytest.mark.parametrize(
    ("name", "found"), [("film.avi", ".gif or .mp4"), ("film.mp4", "imageio-ffmpeg")], ids=["type", "ffmpeg"]
)
def test_what_cannot_be_written_is_refused_before_the_run(name, found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(module, "_ffmpeg", lambda: None)
    out = tmp_path / "run"
    assert main(["run", "single-obstacle", "--can", "off", "--out", str(out), "--render", str(tmp_path / name)]) == 2
    assert found in capsys.readouterr().err
    assert not out.exists()


def test_other_plants_cannot_be_filmed(tmp_path):
    with (
        pytest.raises(InputError, match="--render: the plant is not MuJoCo's"),
        film(LinearPlant(SCENARIO.vehicle), tmp_path / "film.gif", SCENARIO, SimpleNamespace(plan=None)),
    ):
        pass


def test_without_opengl_the_packages_are_named(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(module.importlib, "import_module", missing)
    with pytest.raises(InputError, match="libegl1 libgl1-mesa-dri, or libosmesa6"):
        Camera(MujocoPlant(SCENARIO.vehicle))


@pytest.mark.render
def test_a_film_shows_the_obstacle_and_the_plan(tmp_path):
    controller = SteeringController(SCENARIO.vehicle, SCENARIO.path, SCENARIO.obstacles, SCENARIO.controller)
    file = tmp_path / "film.gif"
    with open_plant(SCENARIO) as plant, film(plant, file, SCENARIO, controller) as shoot:
        state = plant.reset(SCENARIO.start)
        for k in range(3):
            state = plant.step(controller.step(state), 0.05)
            shoot(0.05 * k)
            shoot(0.05 * k)  # no second frame at the same time
    with Image.open(file) as image:
        assert image.n_frames == 3
        picture = np.asarray(image.convert("RGB")).astype(int)
    red = (picture[..., 0] > 150) & (picture[..., 1:].max(axis=-1) < 90)
    white = picture.min(axis=-1) > 220
    assert red.sum() > 100  # the obstacle
    assert white.sum() > 200  # the road's edges
    assert math.isclose(picture.shape[1] / picture.shape[0], 16 / 9, rel_tol=0.01)
