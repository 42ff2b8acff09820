"""Exact discretisation: the exponential of a generator, and of twice the step."""

import math

from sidestep.controller.records import STATES
from sidestep.plant_models.kernels import Array, kernel

WIDTH = 10
"""Columns of a generator: states, then the held inputs of `prediction`."""
MOST_SQUARINGS = 60
"""Bound on the scaling: what needs more is no car, and ends as a step without a solution."""
_R = math.sqrt(177.0)
_X3 = 2.0 / 3.0
_X1, _X2 = _X3 * (1.0 + _R) / 88.0, _X3 * (1.0 + _R) / 352.0
_X4, _X5 = (-271.0 + 29.0 * _R) / (315.0 * _X3), 11.0 * (-1.0 + _R) / (1260.0 * _X3)
_X6, _X7 = 11.0 * (-9.0 + _R) / (5040.0 * _X3), (89.0 - _R) / (5040.0 * _X3**2)
_Y2 = (857.0 - 58.0 * _R) / 630.0
"""Of the polynomial in `exponential`."""


@kernel
def _multiply(a, b, identity, out):
    """Product of upper blocks: of [[a], [0, identity]] with [[b], [0, identity]]; with b's only, if a's is 0."""
    for i in range(STATES):
        for j in range(WIDTH):
            out[i, j] = identity * a[i, j] if j >= STATES else 0.0
        for k in range(STATES):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(WIDTH):
                    out[i, j] += factor * b[k, j]


@kernel
def exponential(a: Array, dt: float, e: Array, products: Array) -> None:
    """Upper rows of the exponential of [[a], [0]] dt by scaling, an eighth-order Taylor polynomial and squaring.

    The scaled norm stays below 1/4, which leaves a truncation error below 1e-11. The polynomial takes three
    products only: Bader, Blanes and Casas, Mathematics 7 (2019) 1174, Section 3.

    Args:
        a: Generator, shape (6, 10).
        dt: In [s].
        e: Filled: [A_k, B_k], shape (6, 10).
        products: Work space, shape (4, 6, 10).
    """
    norm = 0.0
    for i in range(STATES):
        row = 0.0
        for j in range(STATES):
            row += abs(a[i, j])
        norm = max(norm, row * dt)
    squarings = 0
    while norm > 0.25 and squarings < MOST_SQUARINGS:
        norm *= 0.5
        squarings += 1
    scale = dt / 2.0**squarings
    x, x2, x4, product = products[0], products[1], products[2], products[3]
    for i in range(STATES):
        for j in range(WIDTH):
            x[i, j] = a[i, j] * scale
    _multiply(x, x, 0.0, x2)
    for i in range(STATES):
        for j in range(WIDTH):
            product[i, j] = _X1 * x[i, j] + _X2 * x2[i, j]
    _multiply(x2, product, 0.0, x4)
    for i in range(STATES):
        for j in range(WIDTH):
            product[i, j] = _X5 * x[i, j] + _X6 * x2[i, j] + _X7 * x4[i, j]
            x4[i, j] += _X3 * x2[i, j]
    _multiply(x4, product, 0.0, e)
    for i in range(STATES):
        for j in range(WIDTH):
            e[i, j] += x[i, j] + _Y2 * x2[i, j] + _X4 * x4[i, j]
        e[i, i] += 1.0
    for _ in range(squarings):
        square(e, product)


@kernel
def square(e: Array, product: Array) -> None:
    """Turn [A_k, B_k] into that of twice the step; `product` is work space, shape (6, 10)."""
    _multiply(e, e, 1.0, product)
    for i in range(STATES):
        for j in range(WIDTH):
            e[i, j] = product[i, j]
