"""Settings that follow parameters while it runs: what `settings_of` makes of them, without Python."""

import math

from sidestep.controller.decision.stopping import GRIP_SHARE
from sidestep.controller.mpc.car_model import peak_slip
from sidestep.controller.settings import BEND_SHARE, TIGHTENING_TIME
from sidestep.plant_models.kernels import Record, Records, kernel
from sidestep.plant_models.vehicle.parameters import GRAVITY


@kernel
def tune(memory: Records, settings: Records, setups: Records, given: Records) -> None:
    """Let parameters hold from now on; the memory keeps what it may, as `SteeringController.restore` does it.

    Args:
        memory, settings: Records of `MEMORY` and `SETTINGS`, shape (1,).
        setups: Record of `SETUP`, shape (1,).
        given: Record of `PARAMETERS`, shape (1,).
    """
    m, c, g = memory[0], settings[0], given[0]
    _planner(c, g, setups[0].max_braking)
    _weights(c, g)
    _grip(c, g)
    c.buffer, c.tightening, c.standstill_gap = g.buffer, g.tightening, g.standstill_gap
    c.comfort_braking, c.cruise, c.delay = g.comfort_braking, g.cruise_speed, int(g.input_delay_steps)
    for k in range(c.grid.nodes):
        asked = g.tightening * min(c.grid.times[k] / TIGHTENING_TIME, 1.0)
        c.grid.clearance[k] = setups[0].half_width + g.buffer + asked
    _adopt(m, c)


@kernel
def _planner(c: Record, g: Record, max_braking: float) -> None:
    p = c.planner
    p.buffer, p.tightening, p.margin_time, p.safe_distance = g.buffer, g.tightening, g.margin_time, g.safe_distance
    p.least_clearance = min(g.least_clearance, g.buffer)
    p.reference, p.hysteresis = g.reference_offset, g.side_hysteresis
    p.weight_reference, p.weight_continuity = g.weight_reference, g.weight_continuity
    p.weight_obstacle, p.max_lateral_speed, p.max_slope = g.weight_obstacle, g.max_lateral_speed, g.max_slope
    p.comfort_braking, p.braking = g.comfort_braking, min(max_braking, GRIP_SHARE * g.friction * GRAVITY)


@kernel
def _weights(c: Record, g: Record) -> None:
    w = c.weights
    w.offset, w.lateral_speed, w.acceleration = g.weight_offset, g.weight_lateral_speed, g.weight_acceleration
    w.jerk, w.rate, w.corridor, w.slip = g.weight_jerk, g.weight_rate, g.corridor_penalty, g.slip_penalty


@kernel
def _grip(c: Record, g: Record) -> None:
    """Slip at the peaks and what bends may take; a table of validity stays that of the setup's friction."""
    car = c.car
    car.friction = g.friction
    c.peaks[0] = peak_slip(car.stiffness_f, car.load_f, car)
    c.peaks[1] = peak_slip(car.stiffness_r, car.load_r, car)
    c.slip_limits[0], c.slip_limits[1] = g.slip_share * c.peaks[0], g.slip_share * c.peaks[1]
    bends = min(g.bend_acceleration, BEND_SHARE * g.friction * GRAVITY)
    for i in range(c.valid):
        bends = min(bends, c.valid_accelerations[i])
    c.bend_acceleration = bends


@kernel
def _adopt(m: Record, c: Record) -> None:
    """A memory of other settings is made one of these."""
    if not math.isnan(c.cruise):
        m.cruise = c.cruise
    if not c.rejects:
        m.disturbance.actuator = m.disturbance.sensor = m.disturbance.share = m.disturbance.steps = 0.0
    if m.on_the_way > 0:  # the newest stay; room before them is filled with the oldest
        kept = c.delay + 1
        shift = m.on_the_way - kept
        if shift > 0:
            for i in range(kept):
                m.sent[i] = m.sent[i + shift]
        for i in range(kept - 1, -1, -1):
            if shift < 0:
                m.sent[i] = m.sent[max(i + shift, 0)]
        m.on_the_way = kept
