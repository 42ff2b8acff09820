"""Parameters and expressions of OpenSCENARIO: `$name` and `${1.5 * $name}`."""

import ast
import math
import operator
import re
from collections.abc import Mapping
from typing import Any

from sidestep.plant_models.errors import InputError

_OPERATORS: dict[type, Any] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Mod: math.fmod, ast.Pow: lambda a, b: math.pow(a, b), ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
_FUNCTIONS: dict[str, Any] = {
    "sqrt": math.sqrt, "pow": math.pow, "round": lambda x: float(round(x)), "ceil": math.ceil, "floor": math.floor,
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0, "max": max, "min": min, "abs": abs,
    "sin": math.sin, "cos": math.cos, "tan": math.tan,
}  # fmt: skip


def resolved(text: str, parameters: Mapping[str, str], where: str) -> str:
    """An attribute's value with its parameters put in and its expression worked out.

    Raises:
        InputError: Unknown parameter, or an expression that cannot be worked out.
    """
    if "$" not in text:
        return text

    def value(match: re.Match[str]) -> str:
        if match[1] not in parameters:
            raise InputError(where, f"parameter {match[1]!r} is not declared", ", ".join(parameters) or "none is")
        return parameters[match[1]]

    if text.startswith("${") and text.endswith("}"):
        inner = re.sub(r"\$(\w+)", lambda match: f"({value(match)})", text[2:-1])
        try:
            return repr(float(_evaluated(ast.parse(inner.strip(), mode="eval").body)))
        except (SyntaxError, TypeError, ValueError, ArithmeticError, KeyError, RecursionError) as error:
            raise InputError(where, f"{text!r} cannot be worked out ({error})") from error
    return re.sub(r"\$(\w+)", value, text)


def _evaluated(node: ast.AST) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATORS[type(op)](_evaluated(left), _evaluated(right))
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](_evaluated(operand))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return _FUNCTIONS[name](*map(_evaluated, arguments))
    raise ValueError(f"{type(node).__name__} is not allowed")
