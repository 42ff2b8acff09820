"""What is in an FMU, and a mapping file for it proposed by names and units."""

import re
from pathlib import Path
from typing import NamedTuple

from fmpy.model_description import ScalarVariable

from sidestep.fmu.importing.archive import FmuDescription
from sidestep.fmu.importing.mapping import DIMENSIONS, INPUTS, OUTPUTS
from sidestep.fmu.importing.ports import FLOATS, elements
from sidestep.fmu.importing.units import Scale, scale_of, unit_of, without_suffix

_WORDS = {
    "x": ("x", "xpos", "posx", "positionx", "xcg", "xposition", "sx", "tx", "x0", "position0", "pos0"),
    "y": ("y", "ypos", "posy", "positiony", "ycg", "yposition", "sy", "ty", "y0", "position1", "pos1"),
    "yaw": ("yaw", "psi", "theta", "heading", "yawangle", "rz", "yaw0", "psi0", "theta0", "position2", "pos2"),
    "v_x": ("vx", "vlong", "longitudinalvelocity", "vellong", "speedx", "velx", "vx0", "v", "v0", "speed"),
    "v_y": ("vy", "vlat", "lateralvelocity", "vellat", "speedy", "vely", "vy0"),
    "yaw_rate": ("yawrate", "psidot", "psip", "yawvel", "yawvelocity", "omegaz", "wz", "dpsi",
                 "thetadot", "r", "ra", "yawrate0"),
    "steer_angle": ("steerangle", "steer", "steering", "steeringangle", "delta", "deltaf", "deltaw", "roadwheelangle",
                    "steeringwheelangle", "steeringwheel", "handwheel", "handwheelangle", "swa", "delta0",
                    "steeranglecommand", "steercmd", "deltacmd", "steerangle0"),
    "target_speed": ("targetspeed", "vset", "vref", "vtarget", "speedset", "setspeed", "desiredspeed", "speedref",
                     "speedcmd", "vcmd"),
    "acceleration": ("acceleration", "acc", "ax", "accel", "acccmd", "targetacceleration"),
    "throttle": ("throttle", "gas", "gaspedal", "accelerator"),
    "brake": ("brake", "brakepedal", "braking"),
}  # fmt: skip
_HAND_WHEEL = re.compile(r"hand|swa|steering_?wheel", re.IGNORECASE)
_SECTIONS = {"inputs": (INPUTS, ("input",)), "outputs": (OUTPUTS, ("output", "local")),
             "start": (OUTPUTS, ("parameter",))}  # fmt: skip


def describe(fmu: FmuDescription) -> str:
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
    if fmu.remark:
        lines.append(fmu.remark)
    for variable in fmu.variables.values():
        start = "" if variable.start is None else f"= {variable.start}"
        text = f"  {variable.causality or 'local':12}{variable.type:9}{variable.name:32}{unit_of(variable):8}{start}"
        lines.append(f"{text.ljust(76)}{variable.description or ''}".rstrip())
    return "\n".join(lines)


def propose_mapping(fmu: FmuDescription, path: Path) -> str:
    """A mapping file's text, with a comment wherever a person has to look."""
    found = {name: _section(fmu, *rows) for name, rows in _SECTIONS.items()}
    missing = [name for name in OUTPUTS if name not in found["outputs"]]
    lines = [f"# proposed for {path.name} by names and units: check signs, ratios and the reference point"]
    lines.append("reference_point = 0.0  # of the FMU's position, ahead of the centre of gravity [m]")
    if estimate := [name for name in missing if name not in ("x", "y")]:
        lines.append(f"estimate = {estimate!r}  # not found among its outputs".replace("'", '"'))
    for section, rows in found.items():
        lines += ["", f"[{section}]"]
        lines += [f"{name} = {_row(fmu, name, candidate, section)}" for name, candidate in rows.items()]
        if section == "inputs" and "steer_angle" not in rows:
            lines.append('# steer_angle = "?"  # not found: what steers the car?')
        if section == "outputs":
            lines += [f'# {name} = "?"  # not found, but needed' for name in ("x", "y") if name in missing]
    return "\n".join(lines) + "\n"


class _Candidate(NamedTuple):
    """A variable, or an element of an array, by its name in a mapping file."""

    name: str
    variable: ScalarVariable


def _section(fmu: FmuDescription, names: tuple[str, ...], causalities: tuple[str, ...]) -> dict[str, _Candidate]:
    fitting_types = [v for v in fmu.variables.values() if v.causality in causalities and v.type in FLOATS]
    candidates = [_Candidate(name, v) for v in fitting_types for name in elements(v)]
    found: dict[str, _Candidate] = {}
    for name in names:
        left = [candidate for candidate in candidates if candidate not in found.values()]
        ranked = [  # an output before a variable that only happens to be called so
            (causalities.index(str(c.variable.causality)), rank, c)
            for c in left
            if (rank := _rank(fmu, name, c)) is not None
        ]
        if ranked:
            found[name] = min(ranked, key=lambda row: row[:2])[2]
    if "target_speed" in found:  # one way to drive is enough, but where we know what both together mean
        ours = all(found[name].name == name for name in ("target_speed", "acceleration") if name in found)
        others = ("throttle", "brake") if ours else ("acceleration", "throttle", "brake")
        found = {name: c for name, c in found.items() if name not in others}
    return found


def _rank(fmu: FmuDescription, name: str, candidate: _Candidate) -> int | None:
    """How well a variable's name fits a signal, 0 best; None for not at all, or another dimension."""
    if scale_of(fmu.description, candidate.variable, DIMENSIONS[name]) is None:
        return None
    words, plain = _WORDS[name], without_suffix(candidate.name)
    whole, last = (re.sub(r"[^a-z0-9]", "", text.lower()) for text in (plain, plain.split(".")[-1]))
    for rank, spelled in ((0, whole), (len(words), last)):
        if spelled in words:
            return rank + words.index(spelled)
    return None


def _row(fmu: FmuDescription, name: str, candidate: _Candidate, section: str) -> str:
    variable, keys, comment = candidate.variable, [f'variable = "{candidate.name}"'], ""
    scale = scale_of(fmu.description, variable, DIMENSIONS[name]) or Scale()
    if scale.unit:
        keys.append(f'unit = "{scale.unit}"')
    elif scale != Scale():
        keys += [f"scale = {scale.scale!r}"] + ([f"offset = {scale.offset!r}"] if scale.offset else [])
        comment = f"  # {unit_of(variable)}, by the file's own definition"
    if name == "steer_angle" and _HAND_WHEEL.search(candidate.name):
        keys.append("ratio = 16.0")
        comment = "  # steering-wheel angle per road-wheel angle: check"
    elif name == "steer_angle" and section == "inputs" and scale == Scale() and _is_normalised(variable):
        keys.append("full_lock = 0.6")
        comment = "  # road-wheel angle at 1 [rad]: check"
    elif name in ("throttle", "brake"):
        keys.append("scale = 8.0" if name == "brake" else "scale = 3.0")
        comment = "  # acceleration at full pedal [m/s2]: check"
    return f"{{ {', '.join(keys)} }}{comment}"


def _is_normalised(variable: ScalarVariable) -> bool:
    return (variable.min, variable.max) in ((-1.0, 1.0), ("-1", "1"), ("-1.0", "1.0"))
