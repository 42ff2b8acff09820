"""Compiled code is loaded when a controller is made, not in the loop, where it takes up to seconds."""

import subprocess
import sys

import pytest

_DRIVE = """
import sys
from numba.core.dispatcher import Dispatcher
from sidestep.controller import SteeringController
from sidestep.validation.loop.cosimulation import cosimulate
from sidestep.validation.loop.plants import open_plant
from sidestep.validation.scenarios.scenario import load_scenario

def loaded():
    modules = [module for name, module in sys.modules.items() if name.startswith("sidestep.controller")]
    kernels = {k for module in modules for k in vars(module).values() if isinstance(k, Dispatcher)}
    return {(k.py_func.__name__, signature) for k in kernels for signature in k.signatures}

scenario = load_scenario(sys.argv[1], sys.argv[2:])
controller = SteeringController(scenario.vehicle, scenario.path, scenario.obstacles, scenario.controller)
before = loaded()
with open_plant(scenario) as plant:
    cosimulate(controller, plant, scenario)
print(*(loaded() - before))
"""


@pytest.mark.closed_loop
@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("double-obstacle", ()),
        ("moose", ("speed=20",)),  # more than the car can do: nothing is feasible
        ("blocked", ("controller.input_delay_steps=2", "plant.delay=0.04")),
        ("double-obstacle", ("controller.body_roll=true",)),
        ("double-obstacle", ("controller.preset=paper",)),
    ],
)
def test_nothing_is_loaded_in_the_loop(scene, settings):
    command = [sys.executable, "-c", _DRIVE, scene, "plant.kind=linear", *settings]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.strip() == ""
