"""Any co-simulation FMU as a plant; our own are built on first use."""

import math
from pathlib import Path
from typing import Self

from sidestep.fmu.build import build_fmu
from sidestep.fmu.instance import FmuInstance
from sidestep.fmu.mapping import INPUTS, OUTPUTS, Mapping
from sidestep.fmu.variables import vehicle_values
from sidestep.plant_models.errors import InputError, PlantError
from sidestep.plant_models.signals import SteeringCommand, VehicleState
from sidestep.plant_models.vehicle import VehicleParameters


class FmuPlant:
    """A `Plant` that steps an FMU (FMI 2.0 or 3.0) through a mapping of signals to its variables.

    A command that is not finite is not handed on: the FMU holds the last one that was.

    Attributes:
        path: The .fmu file.
        mapping: Where each signal is found in it.
    """

    def __init__(self, path: str | Path, mapping: Mapping):
        """Unpack and load the FMU; `reset` it before the first step.

        Raises:
            InputError: The FMU cannot be used on this machine, or lacks a variable of the mapping.
        """
        self.path, self.mapping = Path(path), mapping
        self._fmu = FmuInstance(path)
        try:
            self._inputs = self._fmu.port([mapping.inputs[name].variable for name in INPUTS])
            self._outputs = self._fmu.port([mapping.outputs[name].variable for name in OUTPUTS])
            self._fmu.port([*mapping.parameters, *(signal.variable for signal in mapping.start.values())])
        except InputError:
            self._fmu.close()
            raise
        self._steer, self._speed = (mapping.inputs[name] for name in INPUTS)
        signals = [mapping.outputs[name] for name in OUTPUTS]
        self._scales = [(signal.scale, signal.offset) for signal in signals]
        self._is_scaled = any(scale != (1.0, 0.0) for scale in self._scales)
        self._origin = self._time = self._dt = 0.0
        self._steps = 0

    @classmethod
    def native(
        cls,
        vehicle: VehicleParameters,
        friction: float = 1.0,
        fmi: int = 3,
        model: str = "single-track",
        **parameters: float,
    ) -> Self:
        """One of our own FMUs, built on first use.

        Args:
            vehicle: The car.
            friction: Of the road, as a factor on the tyres' peak.
            fmi: 2 or 3.
            model: One of `variables.MODELS`.
            parameters: Further parameters of the FMU by name, in SI units: steer_offset, internal_step.

        Raises:
            InputError: No such model, FMI version or parameter.
            CompilerError: The FMU is not built yet and there is no C compiler.
        """
        values = vehicle_values(vehicle) | {"friction": friction} | parameters
        return cls(build_fmu(model, fmi), Mapping(parameters=values))

    @classmethod
    def from_file(
        cls, path: str | Path, mapping: Mapping | str | Path | None = None, vehicle: VehicleParameters | None = None
    ) -> Self:
        """An FMU from anywhere.

        Args:
            path: The .fmu file.
            mapping: A mapping or its TOML file; None for an FMU with our own names.
            vehicle: The car whose numbers an FMU with our own names takes; its own if None.

        Raises:
            InputError: The FMU cannot be used, or does not have what the mapping names.
        """
        if mapping is None:
            mapping = Mapping(parameters=vehicle_values(vehicle) if vehicle else {})
        return cls(path, mapping if isinstance(mapping, Mapping) else Mapping.from_file(mapping))

    def reset(self, state: VehicleState) -> VehicleState:
        """Start a new instance of the FMU at `state`, so far as the mapping has start parameters for it.

        Raises:
            PlantError: The state is not finite, or the FMU refuses it.
        """
        if not state.is_finite():
            raise PlantError(f"cannot start from a state that is not finite: {state}")
        values = dict(self.mapping.parameters)
        for name, signal in self.mapping.start.items():
            values[signal.variable] = signal.from_signal(getattr(state, name))
        values[self._steer.variable] = self._steer.from_signal(state.steer_angle)
        values[self._speed.variable] = self._speed.from_signal(state.v_x)
        self._fmu.start(state.time, values)
        self._inputs.values[:] = [values[name] for name in self._inputs.names]
        self._origin = self._time = state.time
        self._steps = 0
        return self._state()

    def step(self, command: SteeringCommand, dt: float) -> VehicleState:
        """Hold `command` for `dt` seconds.

        Raises:
            PlantError: Not reset since it was built or failed, or the FMU cannot go on.
            InputError: dt is not a positive number.
        """
        if not self._fmu.is_running:
            raise PlantError(f"{self.path.name}: step before reset")
        if not 0.0 < dt < math.inf:
            raise InputError("dt", f"{dt} s", "> 0")
        if math.isfinite(command.steer_angle):
            self._inputs.values[0] = self._steer.from_signal(command.steer_angle)
        if math.isfinite(command.target_speed):
            self._inputs.values[1] = self._speed.from_signal(command.target_speed)
        if dt != self._dt:
            self._origin, self._steps, self._dt = self._time, 0, dt
        self._fmu.set(self._inputs)
        self._fmu.step(self._time, dt)
        self._steps += 1
        self._time = self._origin + self._steps * dt  # never summed up: some FMUs refuse a drifting clock
        return self._state()

    def close(self) -> None:
        """Free the FMU and remove what was unpacked."""
        self._fmu.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _state(self) -> VehicleState:
        self._fmu.get(self._outputs)
        values = self._outputs.values[:]
        if not math.isfinite(sum(values)):
            bad = [name for name, value in zip(self._outputs.names, values, strict=True) if not math.isfinite(value)]
            raise PlantError(f"{self.path.name}: {', '.join(bad)} is not finite at t = {self._time:.6g} s")
        if self._is_scaled:
            values = [scale * value + offset for (scale, offset), value in zip(self._scales, values, strict=True)]
        return VehicleState(self._time, *values)
