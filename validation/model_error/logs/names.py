"""Signals found by their names where a mapping does not tell them."""

import re
from collections.abc import Iterable

NAMES = {
    "steer": (r"road_?wheel_?angle", r"steer(ing)?_?angle_?(front|rw|tyre|tire)", r"delta(_?f)?"),
    "steering_wheel": (
        r"steering_?wheel(_?angle)?", r"sw_?angle", r"swa", r"hand_?wheel_?angle", r"steer(ing)?_?angle", r"lws_?angle",
    ),
    "v_x": (r"v_?x", r"vel(ocity)?_?x", r"long(itudinal)?_?(velocity|speed)", r"(vehicle_?)?speed", r"v", r"v_?ego"),
    "yaw_rate": (r"yaw_?rate", r"psi_?(dot|p)", r"omega(_?z)?", r"gyro_?z", r"yaw_?vel(ocity)?", r"r"),
    "a_y": (r"a_?y", r"acc(el(eration)?)?_?y", r"lat(eral)?_?acc(el(eration)?)?", r"ay_?cg"),
    "a_x": (r"a_?x", r"acc(el(eration)?)?_?x", r"long(itudinal)?_?acc(el(eration)?)?", r"ax_?cg"),
    "v_y": (r"v_?y", r"vel(ocity)?_?y", r"lat(eral)?_?(velocity|speed)"),
    "sideslip": (r"(side_?slip|beta)(_?angle)?", r"slip_?angle(_?cg)?"),
}  # fmt: skip
"""Patterns by signal, the surest first; letters of any case, spaces and dashes as underscores."""


def find(signal: str, names: Iterable[str]) -> str | None:
    """The name that is most surely the signal's, or None.

    Args:
        signal: A key of NAMES.
        names: As the file has them, without units; of CAN signals the last part counts.
    """
    plain = {name: re.sub(r"[\s\-]+", "_", name.rpartition(".")[2].strip()).lower() for name in names}
    for pattern in NAMES[signal]:
        for name, word in plain.items():
            if re.fullmatch(pattern, word):
                return name
    return None
