"""Settings that follow parameters: those that Python makes."""

from dataclasses import replace

import numpy as np
from support.component import scene_of, setup_for

from sidestep.controller.records import MEMORY, record
from sidestep.controller.settings import settings_of
from sidestep.fmu.component.records import HEADER, SETUP, TUNABLE, parameters_of
from sidestep.fmu.component.tuning import tune
from sidestep.plant_models.ranges import bounded_fields


def test_every_parameter_makes_the_settings_that_python_makes():
    scene = scene_of("double-obstacle")
    limits = {field.name: field.range for field in bounded_fields(type(scene.controller))}
    setup = record(SETUP)
    setup[:] = np.frombuffer(setup_for(scene), SETUP, 1, HEADER.itemsize)
    for name in (*TUNABLE, "input_delay_steps"):
        old = getattr(scene.controller, name)
        value = 12.0 if old is None else min(0.7 * old + 0.11, limits[name].high)
        config = replace(scene.controller, **{name: 3 if name == "input_delay_steps" else value})
        settings, memory = settings_of(scene.vehicle, scene.controller), record(MEMORY)
        wanted = settings_of(scene.vehicle, config)
        assert settings.tobytes() != wanted.tobytes()
        tune(memory, settings, setup, parameters_of(config))
        assert settings.tobytes() == wanted.tobytes(), name


def test_a_memory_of_another_delay_keeps_the_newest_commands():
    scene = scene_of("double-obstacle")
    setup, memory, settings = record(SETUP), record(MEMORY), settings_of(scene.vehicle, scene.controller)
    for before, delay, after in (([1.0, 2.0, 3.0], 1, [2.0, 3.0]), ([1.0, 2.0], 3, [1.0, 1.0, 1.0, 2.0])):
        memory["sent"][0, : len(before)], memory["on_the_way"] = before, len(before)
        tune(memory, settings, setup, parameters_of(replace(scene.controller, input_delay_steps=delay)))
        assert memory["on_the_way"][0] == delay + 1
        assert memory["sent"][0, : delay + 1].tolist() == after
