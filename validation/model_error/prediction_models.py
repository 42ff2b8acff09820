"""The three models that predict the car, run over many starting points of a drive at once.

    linear  Eq. (5), (6), discretised exactly
    euler   the same by forward Euler with the step of the paper's controller, Eq. (7)
    affine  the controller's: axle forces as tangents to the Magic Formula about the prediction before (`linearise`),
            discretised exactly; the road's friction is known to it

State [l_s, e_phi, beta, gamma]. All get the realised road-wheel angle: what the steering actuator does is known.
"""

import numpy as np
from numpy.typing import NDArray

from sidestep.controller.mpc.car_model import Car
from sidestep.controller.mpc.discretise import WIDTH, exponential
from sidestep.controller.mpc.prediction import RATE, TURN, least_slopes, model_block, touch
from sidestep.controller.paper import STEP as PAPER_STEP
from sidestep.controller.records import STATES
from sidestep.plant_models.kernels import kernel
from sidestep.plant_models.linear.bicycle import continuous
from sidestep.plant_models.vehicle.parameters import VehicleParameters

Array = NDArray[np.float64]

MODELS = ("linear", "euler", "affine")
STEP = PAPER_STEP
"""Time between the predicted states, in [s]."""
ROUNDS = 3
"""Predictions of the affine model, each with tangents about the one before; by then they have settled."""
_FINE = 5  # exact steps of the linear model per STEP


def predict(
    model: str, vehicle: VehicleParameters, friction: float, start: Array, speed: Array, angles: Array, curvature: float
) -> Array:
    """Predict from every starting point.

    Args:
        model: One of MODELS.
        vehicle: The car as the model knows it.
        friction: Of the road, as a factor on the tyres' peak.
        start: State, shape (w, 4).
        speed: At the start, held over the prediction, shape (w,), in [m/s].
        angles: Realised angle at steps of STEP / 5 from the start on, shape (w, 5 n + 1), in [rad].
        curvature: Of the road, in [1/m].

    Returns:
        Predicted states, the first at STEP after the start, shape (w, n, 4).
    """
    if model == "affine":
        car = Car.of(vehicle, affine=True, friction=friction)._replace(lag=0.0)
        turn_rate = speed * curvature
        return _affine(start, np.maximum(speed, 1.0), angles[:, ::_FINE].copy(), turn_rate, STEP, ROUNDS, car)
    held = 0.5 * (angles[:, 1:] + angles[:, :-1])
    blocks = np.array([_block(vehicle, max(v, 1.0), curvature) for v in speed])
    if model == "linear":
        return _recursion(_exponential(blocks * (STEP / _FINE)), start, held)[:, _FINE - 1 :: _FINE]
    mean = held.reshape(len(held), -1, _FINE).mean(axis=2)
    return _recursion(np.eye(6) + blocks * STEP, start, mean)


def _block(vehicle: VehicleParameters, speed: float, curvature: float) -> Array:
    """Generator of [x; delta; 1], shape (6, 6)."""
    block = np.zeros((6, 6))
    block[:4, :4], block[:4, 4], block[:4, 5] = continuous(vehicle, speed, curvature)
    return block


def _exponential(a: Array) -> Array:
    """Of every matrix, shape (w, n, n), by scaling, a Taylor polynomial and squaring; exact to 1e-12 up to a norm of 4.

    Many small matrices at once, which scipy's takes one by one.
    """
    x = a / 8.0
    e = np.broadcast_to(np.eye(a.shape[-1]), a.shape)
    for k in range(12, 0, -1):
        e = np.eye(a.shape[-1]) + x @ e / k
    for _ in range(3):
        e = e @ e
    return e


def _recursion(transition: Array, start: Array, held: Array) -> Array:
    """States after every step, shape (w, n, 4), of x -> A x + B delta + C; all in `transition`, shape (w, 6, 6)."""
    a, b, c = transition[:, :4, :4], transition[:, :4, 4], transition[:, :4, 5]
    states = np.empty((len(start), held.shape[1], 4))
    x = start
    for k in range(held.shape[1]):
        x = np.einsum("wij,wj->wi", a, x) + b * held[:, k, None] + c
        states[:, k] = x
    return states


@kernel
def _affine(start, speed, angles, turn_rate, step, rounds, car):
    windows, steps = angles.shape[0], angles.shape[1] - 1
    result, states = np.empty((windows, steps, 4)), np.zeros((steps + 1, STATES))
    lines, w, least = np.empty((steps, 5)), np.zeros(STATES + 4), least_slopes(car)
    generator, transition = np.empty((STATES, WIDTH)), np.empty((STATES, WIDTH))
    products = np.empty((4, STATES, WIDTH))
    for i in range(windows):
        v = speed[i]
        states[:] = 0.0  # tangents at zero slip first: the linear prediction with the stiffness of the Magic Formula
        for _ in range(rounds):
            for k in range(steps):
                middle = 0.5 * (states[k] + states[k + 1])
                touch((middle[2], middle[3], middle[4]), (0.0, 0.0), v, least, car, lines[k])
            states[0, :4], states[0, 4], states[0, 5] = start[i], angles[i, 0], angles[i, 0]
            for k in range(steps):
                model_block(v, lines[k, 0], lines[k, 2], car, generator)
                exponential(generator, step, transition, products)
                w[:STATES] = states[k]
                w[RATE], w[TURN] = (angles[i, k + 1] - angles[i, k]) / step, turn_rate[i]
                w[8], w[9] = lines[k, 1], lines[k, 3]
                states[k + 1] = transition @ w
        result[i] = states[1:, :4]
    return result
