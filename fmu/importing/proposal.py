"""What is in an FMU, and a mapping file for it proposed by names and units."""

import re
from pathlib import Path

from fmpy.model_description import ScalarVariable

from sidestep.fmu.importing.archive import UnpackedFmu
from sidestep.fmu.importing.mapping import DIMENSIONS, INPUTS, OUTPUTS, UNITS

_WORDS = {
    "x": ("x", "xpos", "posx", "positionx", "xcg", "xposition", "sx", "tx", "x0"),
    "y": ("y", "ypos", "posy", "positiony", "ycg", "yposition", "sy", "ty", "y0"),
    "yaw": ("yaw", "psi", "heading", "yawangle", "rz", "yaw0", "psi0"),
    "v_x": ("vx", "vlong", "longitudinalvelocity", "vellong", "speedx", "velx", "vx0", "v", "v0", "speed"),
    "v_y": ("vy", "vlat", "lateralvelocity", "vellat", "speedy", "vely", "vy0"),
    "yaw_rate": ("yawrate", "psidot", "psip", "yawvel", "yawvelocity", "omegaz", "wz", "dpsi", "yawrate0"),
    "steer_angle": ("steerangle", "steer", "steering", "steeringangle", "delta", "deltaf", "roadwheelangle",
                    "steeringwheelangle", "steeringwheel", "handwheel", "handwheelangle", "swa", "delta0",
                    "steeranglecommand", "steercmd", "deltacmd", "steerangle0"),
    "target_speed": ("targetspeed", "vset", "vref", "vtarget", "speedset", "setspeed", "desiredspeed", "speedref",
                     "speedcmd", "vcmd"),
    "acceleration": ("acceleration", "acc", "ax", "accel", "acccmd", "targetacceleration"),
    "throttle": ("throttle", "gas", "gaspedal", "accelerator"),
    "brake": ("brake", "brakepedal", "braking"),
}  # fmt: skip
_SPELLINGS = {"°": "deg", "degree": "deg", "degrees": "deg", "kph": "km/h", "kmh": "km/h", "m.s-1": "m/s",
              "rad.s-1": "rad/s", "°/s": "deg/s", "deg.s-1": "deg/s", "m/s^2": "m/s2", "m.s-2": "m/s2"}  # fmt: skip
_HAND_WHEEL = re.compile(r"hand|swa|steering_?wheel", re.IGNORECASE)
_SECTIONS = {"inputs": (INPUTS, ("input",)), "outputs": (OUTPUTS, ("output", "local")),
             "start": (OUTPUTS, ("parameter",))}  # fmt: skip


def describe(fmu: UnpackedFmu) -> str:
    """Variables, units and capabilities as text, one variable a line."""
    interface, experiment = fmu.interface, fmu.description.defaultExperiment
    able = {
        "variable step": interface.canHandleVariableCommunicationStepSize,
        "state save": interface.canGetAndSetFMUstate,
        "state serialisation": interface.canSerializeFMUstate,
        "directional derivatives": interface.providesDirectionalDerivative,
    }
    version = "2.0" if fmu.is_fmi2 else "3.0"
    lines = [
        f"{fmu.name}, FMI {version} co-simulation, made by {fmu.description.generationTool or 'an unnamed tool'}",
        "can: " + (", ".join(name for name, value in able.items() if value) or "none of the optional things"),
    ]
    if fmu.fixed_step:
        lines.append(f"steps by multiples of {fmu.fixed_step:g} s only")
    elif experiment and experiment.stepSize:
        lines.append(f"default step {float(experiment.stepSize):g} s")
    for variable in fmu.variables.values():
        start = "" if variable.start is None else f"= {variable.start}"
        text = f"  {variable.causality or 'local':12}{variable.type:9}{variable.name:32}{unit_of(variable):8}{start}"
        lines.append(f"{text.ljust(76)}{variable.description or ''}".rstrip())
    return "\n".join(lines)


def propose_mapping(fmu: UnpackedFmu, path: Path) -> str:
    """A mapping file's text, with a comment wherever a person has to look."""
    found = {name: _section(fmu, *rows) for name, rows in _SECTIONS.items()}
    missing = [name for name in OUTPUTS if name not in found["outputs"]]
    lines = [f"# proposed for {path.name} by names and units: check signs, ratios and the reference point"]
    lines.append("reference_point = 0.0  # of the FMU's position, ahead of the centre of gravity [m]")
    if estimate := [name for name in missing if name not in ("x", "y")]:
        lines.append(f"estimate = {estimate!r}  # not found among its outputs".replace("'", '"'))
    for section, rows in found.items():
        lines += ["", f"[{section}]"]
        lines += [f"{name} = {_row(name, variable, section)}" for name, variable in rows.items()]
        if section == "inputs" and "steer_angle" not in rows:
            lines.append('# steer_angle = "?"  # not found: what steers the car?')
        if section == "outputs":
            lines += [f'# {name} = "?"  # not found, but needed' for name in ("x", "y") if name in missing]
    return "\n".join(lines) + "\n"


def unit_of(variable: ScalarVariable) -> str:
    """Unit of a variable in our spelling; empty if it has none."""
    unit = variable.unit or getattr(variable.declaredType, "unit", None) or ""
    return _SPELLINGS.get(unit, unit)


def _section(fmu: UnpackedFmu, names: tuple[str, ...], causalities: tuple[str, ...]) -> dict[str, ScalarVariable]:
    candidates = [v for v in fmu.variables.values() if v.causality in causalities and v.type in ("Real", "Float64")]
    candidates.sort(key=lambda v: causalities.index(v.causality))
    found: dict[str, ScalarVariable] = {}
    for name in names:
        fitting = [(rank, v) for v in candidates if (rank := _rank(name, v)) is not None and v not in found.values()]
        if fitting:
            found[name] = min(fitting, key=lambda pair: pair[0])[1]
    if "target_speed" in found:  # one way to drive is enough
        found = {name: v for name, v in found.items() if name not in ("acceleration", "throttle", "brake")}
    return found


def _rank(name: str, variable: ScalarVariable) -> int | None:
    """How well a variable's name fits a signal, 0 best; None for not at all, or another dimension."""
    unit, words = unit_of(variable), _WORDS[name]
    if unit not in ("", "1") and unit not in UNITS[DIMENSIONS[name]]:
        return None
    whole, last = (re.sub(r"[^a-z0-9]", "", text.lower()) for text in (variable.name, variable.name.split(".")[-1]))
    for rank, candidate in ((0, whole), (len(words), last)):
        if candidate in words:
            return rank + words.index(candidate)
    return None


def _row(name: str, variable: ScalarVariable, section: str) -> str:
    unit, keys, comment = unit_of(variable), [f'variable = "{variable.name}"'], ""
    if unit in UNITS[DIMENSIONS[name]]:
        keys.append(f'unit = "{unit}"')
    if name == "steer_angle" and _HAND_WHEEL.search(variable.name):
        keys.append("ratio = 16.0")
        comment = "  # steering-wheel angle per road-wheel angle: check"
    elif name == "steer_angle" and section == "inputs" and unit in ("", "1") and _is_normalised(variable):
        keys.append("full_lock = 0.6")
        comment = "  # road-wheel angle at 1 [rad]: check"
    elif name in ("throttle", "brake"):
        keys.append("scale = 8.0" if name == "brake" else "scale = 3.0")
        comment = "  # acceleration at full pedal [m/s2]: check"
    return f"{{ {', '.join(keys)} }}{comment}"


def _is_normalised(variable: ScalarVariable) -> bool:
    return (variable.min, variable.max) in ((-1.0, 1.0), ("-1", "1"), ("-1.0", "1.0"))
