"""The exported controller in tests: made, started, and stepped as a master does it."""

from contextlib import contextmanager
from dataclasses import astuple

from support.component import command_of, scene_of

from sidestep.fmu.exporting.controller_variables import STATE
from sidestep.fmu.exporting.export import export_controller
from sidestep.fmu.importing.instance import FmuInstance

COMMAND = ["steer_angle_command", "acceleration", "target_speed", "status"]
OBSTACLE = ("s", "l", "length", "width", "heading", "speed", "time")


def export(fmi, name="double-obstacle", obstacles=None):
    scene = scene_of(name)
    obstacles = scene.obstacles if obstacles is None else obstacles
    return export_controller(scene.name, scene.vehicle, scene.path, obstacles, scene.controller, scene.start, fmi)


@contextmanager
def running(fmi, file=None, **parameters):
    fmu = FmuInstance(file or export(fmi))
    try:
        fmu.start(0.0, parameters)
        yield fmu
    finally:
        fmu.close()


def obstacle_names(fmi, index):
    """Variables of an obstacle, counted from 0."""
    return [f"obstacle[{index + 1}].{n}" if fmi == 2 else f"obstacle.{n}[{index}]" for n in OBSTACLE]


class Driver:
    """Steps the FMU as a master does, without delay."""

    def __init__(self, fmu, further=()):
        self.fmu = fmu
        self.inputs = fmu.port([name for name, *_ in STATE])
        self.outputs = fmu.port([*COMMAND, *further])

    def step(self, state, dt=0.02):
        self.inputs.values[:] = astuple(state)[1:]
        self.fmu.set(self.inputs)
        self.fmu.step(state.time, dt)
        self.fmu.get(self.outputs)
        return self.outputs.values[:]


def numbers(row):
    """A command of `drive_here` as the FMU's outputs."""
    return [float(value) for value in row[1:]]


def answer_of(controller, state):
    controller.step(state)
    return numbers(command_of(controller))
