"""The deadlines that pace a node: absolute, never made up for, and what is counted of them."""

import math

import pytest

from sidestep.controller.can_port.bus.pacing import Pacer


class Clock:
    """Time that only passes in `sleep`, when told to, and a little when looked at."""

    def __init__(self):
        self.now, self.late = 100.0, 0.0

    def __call__(self):
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now += seconds + self.late


@pytest.mark.parametrize("late", [0.0, 5e-5, 0.0021])
def test_deadlines_are_absolute(late):
    clock = Clock()
    pacer, times = Pacer(0.01, clock, clock.sleep), []
    clock.late = late
    for _ in range(1001):
        pacer.wait()
        times.append(clock.now)
        clock.now += 0.003  # work
    assert times[-1] - times[1] == pytest.approx(9.99, abs=1e-5)
    figures = pacer.statistics()
    assert (figures["cycles"], figures["skipped"]) == (1000, 0)
    assert abs(figures["drift"]) < 1e-4
    assert figures["lateness_ms"]["p50"] == pytest.approx(1e3 * late, abs=5e-3)
    assert figures["busy"] == pytest.approx(0.3, abs=1e-3)
    assert pacer.now() == pytest.approx(10.003 + late, abs=1e-5)


def test_drift_is_the_slope_of_the_lateness():
    clock = Clock()
    pacer = Pacer(0.01, clock, clock.sleep)
    for k in range(1000):
        clock.late = 1e-4 + 1e-6 * k
        pacer.wait()
    assert pacer.statistics()["drift"] == pytest.approx(1e-4, rel=0.02)


@pytest.mark.parametrize("heard", [0.0, 0.003, 0.0049, 0.0051, 0.0099, -0.004, 1.237])
def test_a_follower_wakes_half_a_cycle_behind_what_it_heard_and_never_earlier_than_before(heard):
    clock = Clock()
    pacer = Pacer(0.01, clock, clock.sleep)
    pacer.wait()
    pacer.wait()
    pacer.follow(heard)
    times = [pacer.wait() for _ in range(3)]
    assert 0.02 - 1e-9 <= times[0] < 0.03
    assert (times[0] - heard - 0.005) / 0.01 == pytest.approx(round((times[0] - heard - 0.005) / 0.01), abs=1e-9)
    assert times == pytest.approx([times[0], times[0] + 0.01, times[0] + 0.02])
    assert pacer.now() == pytest.approx(times[-1], abs=1e-5)


def test_figures_count_from_the_beginning_to_the_end():
    clock = Clock()
    pacer = Pacer(0.01, clock, clock.sleep)
    for k in range(30):
        if k == 10:
            pacer.begin()
        clock.now += {5: 0.048, 15: 0.025}.get(k, 0.0)
        pacer.wait()
    figures = pacer.statistics()
    assert (figures["skipped"], figures["lateness_ms"]["max"]) == (1, pytest.approx(5.0, abs=5e-3))
    assert figures["latest_end_ms"] == pytest.approx(25.0, abs=5e-3)  # it stood still while it was awake
    early = pacer.statistics(until=0.15)
    assert early["cycles"] < figures["cycles"]
    assert early["lateness_ms"]["max"] == pytest.approx(0.0, abs=5e-3)


@pytest.mark.parametrize(("busy", "slot", "skipped"), [(0.0099, 1, 0), (0.0101, 1, 0), (0.0199, 1, 0), (0.0201, 2, 1),
                                                       (0.5051, 50, 49)])  # fmt: skip
def test_missed_deadlines_are_skipped_never_made_up_for(busy, slot, skipped):
    clock = Clock()
    pacer = Pacer(0.01, clock, clock.sleep)
    assert pacer.wait() == 0.0
    clock.now += busy
    assert pacer.wait() == pytest.approx(slot * 0.01)
    assert pacer.skipped == skipped
    before = clock.now
    pacer.wait()
    assert clock.now == pytest.approx(100.0 + (slot + 1) * 0.01, abs=1e-5)
    assert clock.now > before


def test_statistics_of_nothing():
    figures = Pacer(0.01).statistics()
    assert (figures["cycles"], figures["drift"]) == (0, 0.0)
    assert math.isnan(figures["lateness_ms"]["p99"])
