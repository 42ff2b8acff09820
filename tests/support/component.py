"""The C component in tests: loaded by ctypes, with records as numpy arrays."""

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from dataclasses import astuple, replace

import numpy as np

from sidestep.controller import SteeringController
from sidestep.controller.records import COMMAND, MEMORY, STATE
from sidestep.fmu.component.records import PARAMETERS, obstacle_rows, setup_of
from sidestep.plant_models.linear.plant import LinearPlant
from sidestep.validation.scenarios.scenario import load_scenario

OK, INPUT, TOO_MANY, ARENA, FOREIGN, RANGE = range(6)
MEMORY_BYTES = 24 + MEMORY.itemsize
FUNCTIONS = {
    "abi": (c_uint32,), "create": (c_void_p, c_char_p, c_size_t, POINTER(c_char_p)), "free": (None, c_void_p),
    "reset": (None, c_void_p), "step": (c_int, c_void_p, c_void_p, c_void_p, c_size_t, c_void_p),
    "clearance": (c_double, c_void_p, c_void_p, c_void_p, c_size_t),
    "get_parameters": (None, c_void_p, c_void_p), "set_parameters": (c_int, c_void_p, c_void_p),
    "memory_size": (c_size_t,), "save": (c_int, c_void_p, c_void_p, c_size_t),
    "restore": (c_int, c_void_p, c_char_p, c_size_t), "instance_size": (c_size_t, c_void_p),
    "arena_peak": (c_size_t, c_void_p), "last_plan": (c_void_p, c_void_p),
}  # fmt: skip


def load(file):
    library = ctypes.CDLL(str(file))
    for name, (result, *arguments) in FUNCTIONS.items():
        function = getattr(library, f"sidestep_{name}")
        function.restype, function.argtypes = result, arguments
    return library


class Component:
    """An instance of the library."""

    def __init__(self, library, setup, obstacles=()):
        problem = c_char_p()
        self._library, self.obstacles = library, obstacle_rows(obstacles)
        self._handle = library.sidestep_create(setup, len(setup), ctypes.byref(problem))
        if not self._handle:
            raise ValueError(problem.value.decode())
        self.state, self.answer = np.zeros(1, STATE), np.zeros(1, COMMAND)
        self.parameters = np.zeros(1, PARAMETERS)
        self.call("get_parameters", self.parameters.ctypes.data)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.call("free")

    def call(self, name, *arguments):
        return getattr(self._library, f"sidestep_{name}")(self._handle, *arguments)

    def step(self, state):
        """Status of the call, and the command as numbers."""
        self.state.view(np.float64)[:] = astuple(state)
        seen = self.obstacles
        status = self.call("step", self.state.ctypes.data, seen.ctypes.data, len(seen), self.answer.ctypes.data)
        return status, self.answer[0].item()

    def tune(self, **values):
        for name, value in values.items():
            self.parameters[name] = value
        return self.call("set_parameters", self.parameters.ctypes.data)

    def save(self):
        memory = np.zeros(MEMORY_BYTES, np.uint8)
        assert self.call("save", memory.ctypes.data, len(memory)) == OK
        return memory.tobytes()

    def restore(self, data):
        return self.call("restore", data, len(data))


def scene_of(name, *changes):
    scene = load_scenario(name, list(changes))
    return replace(scene, controller=replace(scene.controller, solver="active-set"))


def setup_for(scene):
    return setup_of(scene.vehicle, scene.path, scene.controller)


def in_process(scene, **settings):
    return SteeringController(scene.vehicle, scene.path, scene.obstacles, replace(scene.controller, **settings))


def command_of(controller):
    """The controller's last command as numbers."""
    return controller._memory["command"][0].item()


def drive(scene, count=None):
    """States, commands and the memory at the end of a drive in this process; PIQP must not be asked."""
    controller, plant, rows = in_process(scene), LinearPlant(scene.vehicle), []
    controller._solver.solve = None
    state, period = plant.reset(scene.start), scene.controller.period
    for _ in range(count or round(scene.duration / period)):
        command = controller.step(state)
        rows.append((state, command_of(controller)))
        state = plant.step(command, period)
    return rows, controller.save()
