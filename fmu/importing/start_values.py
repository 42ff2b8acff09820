"""Start values of variables that are no floating-point numbers."""

from typing import Any

from fmpy.model_description import ScalarVariable

from sidestep.plant_models.errors import InputError

_WHOLE = {True: "Integer", False: "Int64"}


def set_others(
    slave: Any, where: str, variables: dict[str, ScalarVariable], values: dict[str, Any], fmi2: bool
) -> None:
    """Hand whole numbers, true and false, enumerations and texts to an instance.

    Args:
        slave: fmpy's.
        where: For errors.
        variables: By name.
        values: By name.
        fmi2: Of FMI 2.0, else 3.0.

    Raises:
        InputError: A value does not fit its variable's type.
    """
    for name, value in values.items():
        kind = str(variables[name].type)
        kind = _WHOLE[fmi2] if kind == "Enumeration" else kind
        getattr(slave, f"set{kind}")([variables[name].valueReference], [_fitting(where, name, kind, value)])


def _fitting(where: str, name: str, kind: str, value: Any) -> Any:
    if kind == "String":
        if not isinstance(value, str):
            raise InputError(where, f"{name!r} of type String cannot be {value}", "a text")
        return value
    if isinstance(value, str):
        raise InputError(where, f"{name!r} of type {kind} cannot be {value!r}", "a number")
    if kind == "Binary":
        raise InputError(where, f"{name!r} is of type Binary", "numbers, true, false and texts")
    if value != int(value):
        raise InputError(where, f"{name!r} of type {kind} cannot be {value}", "a whole number")
    return bool(value) if kind == "Boolean" else int(value)
