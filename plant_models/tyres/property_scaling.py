"""What stands beside the coefficients of a tyre property file and changes them: scaling factors and inflation pressure.

Both are constants of a run, so they go into the coefficients: the law itself has neither. After Pacejka, Tire and
Vehicle Dynamics, 3rd ed., section 4.3.2; of MF-Tyre 5.2 also what its camber factors scale.
"""

from collections.abc import Mapping

FACTORS: dict[str, dict[str, int]] = {
    "LFZO": {"nominal_load": 1},
    "LCX": {"p_cx1": 1},
    "LMUX": {"p_dx1": 1, "p_dx2": 1, "p_vx1": 1, "p_vx2": 1},
    "LEX": {"p_ex1": 1, "p_ex2": 1, "p_ex3": 1},
    "LKX": {"p_kx1": 1, "p_kx2": 1},
    "LHX": {"p_hx1": 1, "p_hx2": 1},
    "LVX": {"p_vx1": 1, "p_vx2": 1},
    "LGAX": {"p_dx3": 2},
    "LCY": {"p_cy1": 1},
    "LMUY": {
        "p_dy1": 1, "p_dy2": 1, "p_vy1": 1, "p_vy2": 1, "p_vy3": 1, "p_vy4": 1, "q_bz1": -1, "q_bz2": -1, "q_bz3": -1,
        "q_bz9": -1, "q_dz6": 1, "q_dz7": 1, "q_dz8": 1, "q_dz9": 1,
    },
    "LEY": {"p_ey1": 1, "p_ey2": 1},
    "LKY": {"p_ky1": 1, "q_bz1": 1, "q_bz2": 1, "q_bz3": 1, "q_bz9": 1},
    "LHY": {"p_hy1": 1, "p_hy2": 1},
    "LVY": {"p_vy1": 1, "p_vy2": 1},
    "LGAY": {"p_dy3": 2, "p_ky3": 1, "p_ey4": 1, "p_hy3": 1, "p_vy3": 1, "p_vy4": 1},
    "LKYC": {"p_ky6": 1, "p_ky7": 1, "p_vy3": 1, "p_vy4": 1},
    "LTR": {"q_dz1": 1, "q_dz2": 1},
    "LRES": {"q_dz6": 1, "q_dz7": 1},
    "LGAZ": {
        "q_bz4": 1, "q_bz5": 1, "q_dz3": 1, "q_dz4": 2, "q_dz8": 1, "q_dz9": 1, "q_ez5": 1, "q_hz3": 1, "q_hz4": 1,
    },
    "LKZC": {"q_dz8": 1, "q_dz9": 1},
    "LXAL": {"r_bx1": 1, "r_bx3": 1},
    "LYKA": {"r_by1": 1, "r_by4": 1},
    "LVYKA": {"r_vy1": 1, "r_vy2": 1, "r_vy3": 1},
    "LS": {"s_sz1": 1, "s_sz2": 1, "s_sz3": 1, "s_sz4": 1},
    "LSGKP": {"relaxation_x": 1},
    "LSGAL": {"relaxation_y": 1},
}  # fmt: skip
"""Powers of each scaling factor by which it multiplies coefficients."""

SYNONYMS = {"LKXK": "LKX", "LKYA": "LKY", "LKYG": "LKYC", "LYKAP": "LYKA", "LXALPHA": "LXAL", "LFZ0": "LFZO"}
"""Other spellings that files have."""

WITHOUT_EFFECT = ("LMX", "LVMX", "LMY", "LMP", "LGYR", "LCZ", "LMUV", "LMPHI", "LMXM", "LCC", "LCFX", "LCFY", "LCMZ")
"""Factors on what the law does not have."""

PRESSURE: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "p_kx1": ("PPX1", "PPX2", ("p_kx1", "p_kx2")),
    "p_dx1": ("PPX3", "PPX4", ("p_dx1", "p_dx2")),
    "p_ky1": ("PPY1", "", ("p_ky1",)),
    "p_ky2": ("PPY2", "", ("p_ky2", "p_ky5")),
    "p_dy1": ("PPY3", "PPY4", ("p_dy1", "p_dy2")),
    "p_ky6": ("PPY5", "", ("p_ky6", "p_ky7")),
    "q_dz1": ("-PPZ1", "", ("q_dz1", "q_dz2")),
    "q_dz6": ("PPZ2", "", ("q_dz6", "q_dz7")),
}
"""Linear and squared influence of the pressure, (p - p_0) / p_0, on groups of coefficients."""


def scaled(numbers: Mapping[str, float], factors: Mapping[str, float]) -> dict[str, float]:
    """Coefficients with the scaling factors in them.

    Args:
        numbers: Coefficients by our names.
        factors: Of FACTORS, by the file's names.
    """
    result = dict(numbers)
    for factor, value in factors.items():
        for name, power in FACTORS[factor].items():
            if name in result:
                result[name] *= value**power
    return result


def inflated(numbers: Mapping[str, float], influence: Mapping[str, float], change: float) -> dict[str, float]:
    """Coefficients at another pressure.

    Args:
        numbers: Coefficients by our names.
        influence: The file's PP.. coefficients; those that it does not give are 0.
        change: (p - p_0) / p_0.
    """
    result = dict(numbers)
    for linear, squared, group in PRESSURE.values():
        sign = -1.0 if linear.startswith("-") else 1.0
        factor = 1.0 + sign * influence.get(linear.lstrip("-"), 0.0) * change + influence.get(squared, 0.0) * change**2
        for name in group:
            if name in result:
                result[name] *= factor
    return result
