"""Any co-simulation FMU as a plant."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Self

from sidestep.fmu.description.plants import vehicle_values
from sidestep.fmu.description.variables import ACCELERATION_START
from sidestep.fmu.importing.estimation import Estimator, unwrapped
from sidestep.fmu.importing.instance import FmuInstance
from sidestep.fmu.importing.mapping import INPUTS, OUTPUTS, Mapping
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.speed_control import asked_acceleration, drive_asked, limited_acceleration
from sidestep.plant_models.vehicle.parameters import VehicleParameters


class FmuPlant:
    """A `Plant` that steps an FMU (FMI 2.0 or 3.0) through a mapping of signals to its variables.

    A command that is not finite is not handed on: the FMU holds the last one that was.

    Attributes:
        path: The .fmu file.
        mapping: Where each signal is found in it.
    """

    def __init__(self, path: str | Path, mapping: Mapping, vehicle: VehicleParameters | None = None):
        """Unpack and load the FMU; `reset` it before the first step.

        Args:
            path: The .fmu file.
            mapping: Where each signal is found in it.
            vehicle: Whose braking and acceleration limit an FMU without target speed; the first preset if None.

        Raises:
            InputError: The FMU cannot be used on this machine, or lacks a variable of the mapping.
        """
        self.path = Path(path)
        self._fmu = FmuInstance(path)
        self.mapping = mapping = mapping.without_unknown(self._fmu.variables)
        self._input_names = [name for name in INPUTS if name in mapping.inputs]
        self._output_names = [name for name in OUTPUTS if name in mapping.outputs]
        try:
            self._inputs = self._fmu.port([mapping.inputs[name].variable for name in self._input_names])
            self._outputs = self._fmu.port([mapping.outputs[name].variable for name in self._output_names])
            self._fmu.port([signal.variable for signal in mapping.start.values()])
            self._fmu.check_known(mapping.parameters)
        except InputError:
            self._fmu.close()
            raise
        self._scales = [(s.scale, s.offset) for s in (mapping.outputs[name] for name in self._output_names)]
        self._is_foreign = not mapping.is_own
        self._estimator = Estimator(mapping.estimate)
        self._limits = (vehicle.max_braking, vehicle.max_acceleration) if vehicle else (8.0, 3.0)
        self._origin = self._time = self._dt = 0.0
        self._steps = 0
        self._signals: dict[str, float] = {}
        self._command = SteeringCommand(0.0, 0.0, 0.0)
        self._standing: tuple[tuple[VehicleState, Mapping], VehicleState] | None = None

    @property
    def estimated(self) -> tuple[str, ...]:
        """Signals of the state that the FMU does not report."""
        return self.mapping.estimate

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        mapping: Mapping | str | Path | None = None,
        vehicle: VehicleParameters | None = None,
        friction: float = 1.0,
    ) -> Self:
        """An FMU from anywhere.

        Args:
            path: The .fmu file.
            mapping: A mapping or its TOML file; None for an FMU with our own names.
            vehicle: The car whose numbers an FMU with our own names takes; its own if None.
            friction: Of the road, for its parameter `friction`; 1 leaves that as it is.

        Raises:
            InputError: The FMU cannot be used, or does not have what the mapping names, or no friction to set.
        """
        if mapping is None:
            plant = cls(path, Mapping(), vehicle)
            values = vehicle_values(vehicle) if vehicle else {}
            known = {name: value for name, value in values.items() if name in plant._fmu.variables}
            plant.mapping = replace(plant.mapping, parameters={**known})
        else:
            plant = cls(path, mapping if isinstance(mapping, Mapping) else Mapping.from_file(mapping), vehicle)
        if not math.isclose(friction, 1.0):
            plant._set_friction(friction)
        return plant

    def _set_friction(self, friction: float) -> None:
        variable = self._fmu.variables.get("friction")
        if variable is None or variable.causality != "parameter":
            self.close()
            raise InputError("plant.friction", f"{friction}: {self.path.name} has no parameter friction", "1.0")
        self.mapping = replace(self.mapping, parameters=self.mapping.parameters | {"friction": friction})

    def reset(self, state: VehicleState) -> VehicleState:
        """Start a new instance of the FMU at `state`, so far as the mapping has start parameters for it.

        One that stands there already, not stepped since, is left alone: some FMUs start only once per process.

        Raises:
            PlantError: The state is not finite, or the FMU refuses it.
        """
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        if self._standing and self._standing[0] == (state, self.mapping):
            return self._standing[1]
        began = self._begin(state)
        self._standing = (state, self.mapping), began
        return began

    def _begin(self, state: VehicleState) -> VehicleState:
        self._standing = None
        values, placed = dict(self.mapping.parameters), self._at_reference_point(state)
        for name, signal in self.mapping.start.items():
            values[signal.variable] = signal.from_signal(getattr(placed, name))
        self._command = SteeringCommand(state.time, state.steer_angle, state.v_x)
        inputs = self._input_values(state.v_x)
        self._fmu.start(state.time, values | dict(zip(self._inputs.names, inputs, strict=True)))
        self._inputs.values[:] = inputs
        self._origin = self._time = state.time
        self._steps = 0
        self._signals = {name: getattr(placed, name) for name in OUTPUTS}
        reported = self._reported()
        if self._is_foreign:
            return self._at_centre(self._estimator.reset(placed, reported))
        return VehicleState(self._time, *reported.values())

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds.

        Raises:
            PlantError: Not reset since it was built or failed, or the FMU cannot go on.
            InputError: dt is not a positive number, or no step that the FMU can make.
        """
        if not self._fmu.is_running:
            raise PlantError(f"{self.path.name}: step before reset")
        if not 0.0 < dt < math.inf:
            raise InputError("dt", f"{dt} s", "> 0")
        self._standing = None
        self._hold(command)
        if dt != self._dt:
            self._origin, self._steps, self._dt = self._time, 0, dt
        self._fmu.set(self._inputs)
        self._fmu.step(self._time, dt)
        self._steps += 1
        self._time = self._origin + self._steps * dt  # never summed up: some FMUs refuse a drifting clock
        if not self._is_foreign:
            return VehicleState(self._time, *self._values())
        signals = self._estimator.complete(self._time, self._reported(), self._command.steer_angle)
        return self._at_centre(signals)

    def close(self) -> None:
        """Free the FMU and remove what was unpacked."""
        self._standing = None
        self._fmu.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _hold(self, command: SteeringCommand) -> None:
        steer, held = command.steer_angle, self._command
        speed, acceleration = drive_asked(command, (held.target_speed, held.acceleration))
        steer = steer if math.isfinite(steer) else held.steer_angle
        self._command = SteeringCommand(command.time, steer, speed, acceleration=acceleration)
        self._inputs.values[:] = self._input_values(self._signals["v_x"])

    def _input_values(self, speed: float) -> list[float]:
        """Values of the input variables for the command in force, at this speed in [m/s]."""
        steer, target, wanted = self._command.steer_angle, self._command.target_speed, self._command.acceleration
        if not self._is_foreign:
            given = wanted if math.isfinite(wanted) else ACCELERATION_START
            return [steer, target, given][: len(self._input_names)]
        braking, driving = self._limits
        pedals = min(max(wanted, -braking), driving)
        if not math.isfinite(wanted):
            pedals = limited_acceleration(speed, max(target, 0.0), braking, driving)
        signals = {
            "steer_angle": steer, "target_speed": target,
            "acceleration": asked_acceleration(speed, max(target, 0.0), wanted, braking, driving),
            "throttle": max(pedals, 0.0), "brake": max(-pedals, 0.0),
        }  # fmt: skip
        return [self.mapping.inputs[name].from_signal(signals[name]) for name in self._input_names]

    def _values(self) -> list[float]:
        """The outputs in the FMU's units."""
        self._fmu.get(self._outputs)
        values = self._outputs.values[:]
        if not math.isfinite(sum(values)):
            bad = [name for name, value in zip(self._outputs.names, values, strict=True) if not math.isfinite(value)]
            raise PlantError(f"{self.path.name}: {', '.join(bad)} is not finite at t = {self._time:.6g} s")
        return values

    def _reported(self) -> dict[str, float]:
        """The outputs as signals in SI units, angles continuous."""
        rows = zip(self._output_names, self._scales, self._values(), strict=True)
        signals = {name: scale * value + offset for name, (scale, offset), value in rows}
        if "yaw" in signals and self._is_foreign:
            signals["yaw"] = unwrapped(signals["yaw"], self._signals["yaw"])
        return signals

    def _at_centre(self, signals: dict[str, float]) -> VehicleState:
        """The state at the centre of gravity."""
        self._signals, ahead, yaw = signals, self.mapping.reference_point, signals["yaw"]
        x, y = signals["x"] - ahead * math.cos(yaw), signals["y"] - ahead * math.sin(yaw)
        v_y = signals["v_y"] - ahead * signals["yaw_rate"]
        return VehicleState(self._time, x, y, yaw, signals["v_x"], v_y, signals["yaw_rate"], signals["steer_angle"])

    def _at_reference_point(self, state: VehicleState) -> VehicleState:
        ahead = self.mapping.reference_point
        x, y = state.x + ahead * math.cos(state.yaw), state.y + ahead * math.sin(state.yaw)
        return replace(state, x=x, y=y, v_y=state.v_y + ahead * state.yaw_rate)
