"""The picture of MuJoCo's scene in the report."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sidestep.controller import SteeringController
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.report import film
from sidestep.validation.report.still import still
from sidestep.validation.scenarios.scenario import load_scenario


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("double-obstacle", ["duration=0.2", "plant.delay=0.02", "start.s=12.0"])


@pytest.fixture(scope="module")
def recording(scenario):
    controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
    with open_plant(scenario) as plant:
        return cosimulate(controller, plant, scenario)


def test_other_plants_have_none(scenario, recording):
    assert still(replace(scenario, plant=replace(scenario.plant, kind="linear")), recording, 0.1) == ""


def test_without_opengl_a_sentence_names_the_packages(scenario, recording, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(film.importlib, "import_module", missing)
    sentence = still(scenario, recording, None)
    assert "neither EGL nor OSMesa works here" in sentence
    assert "libosmesa6" in sentence
    assert "<img" not in sentence


@pytest.mark.render
def test_the_picture_shows_car_obstacle_and_plan(scenario, recording):
    element = still(scenario, recording, 0.15)
    assert "0.15 s, closest approach" in element
    found = re.search(r'src="data:image/jpeg;base64,([^"]+)"', element)
    assert found
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(found[1])))).astype(int)
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    assert picture.shape == (*film.SIZE, 3)
    assert ((red > 130) & (green < 90) & (blue < 90)).sum() > 300  # the obstacle
    assert ((blue > 130) & (red < 90) & (green < 130)).sum() > 300  # the car
    assert ((red > 200) & (green > 120) & (blue < 90)).sum() > 100  # the prediction
