"""Settings: presets, overrides, and an error for everything else."""

import math

import pytest

from sidestep.controller import PRESETS, ControllerConfig
from sidestep.plant_models.errors import InputError


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_are_valid(name):
    config = ControllerConfig.preset(name)
    for key, value in PRESETS[name].items():
        assert getattr(config, key) == value


def test_overrides_win():
    assert ControllerConfig.preset("paper", buffer=0.3).buffer == 0.3


@pytest.mark.parametrize(
    ("overrides", "where"),
    [
        ({"buffer": -0.1}, "controller.buffer"),
        ({"period": 0.0}, "controller.period"),
        ({"friction": math.nan}, "controller.friction"),
        ({"width_left": "wide"}, "controller.width_left"),
        ({"buffer": True}, "controller.buffer"),
        ({"input_delay_steps": 1.5}, "controller.input_delay_steps"),
        ({"input_delay_steps": -1}, "controller.input_delay_steps"),
        ({"formulation": "magic"}, "controller.formulation"),
        ({"bufer": 0.2}, "controller.bufer"),
    ],
)
def test_bad_values_name_their_key(overrides, where):
    with pytest.raises(InputError) as error:
        ControllerConfig.preset("default", **overrides)
    assert error.value.where == where


def test_unknown_preset_lists_those_there_are():
    with pytest.raises(InputError, match="default, paper"):
        ControllerConfig.preset("sport")
