"""A car that follows is left in peace, one that does not is noticed, on drives with known speeds."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.rover_dynamics import RoverDynamics
from drivers.vehicle import DriveCommand
from tools.speed_watch import SpeedWatch

TICK_S = 0.05


def noticed_s(told, reported, seconds=8.0):
    """When told(t) and reported(t) are first said not to agree, None if never."""
    watch = SpeedWatch()
    for now_s in np.arange(0.0, seconds, TICK_S):
        speed = reported(now_s)
        if speed is not None:
            watch.report(now_s, speed)
        if watch.tell(now_s, told(now_s)):
            return now_s
    return None


def test_a_car_with_latency_and_limits_is_left_in_peace():
    car = RoverDynamics(np.zeros(3))
    told = lambda t: (0.5, 0.0, -0.4, 0.2)[int(t // 1.7) % 4]  # noqa: E731
    assert noticed_s(told, lambda t: car.step(TICK_S, DriveCommand(told(t), 0.0)).speed_mps, 20.0) is None


@pytest.mark.parametrize("noise_mps", [0.0, 0.1])
def test_a_car_that_drives_on_is_noticed(noise_mps):
    random = np.random.default_rng(1)
    found = noticed_s(lambda t: 0.5 if t < 3.0 else 0.0, lambda _: 0.5 + noise_mps * random.uniform(-1.0, 1.0))
    assert 3.5 < found <= 4.6


def test_a_car_that_stands_is_noticed_and_one_that_goes_the_other_way():
    assert noticed_s(lambda t: 0.5 if t > 1.0 else 0.0, lambda t: 0.0) <= 2.6
    assert noticed_s(lambda _: 0.5, lambda _: -0.5) <= 0.6


def test_slow_crawling_that_a_motor_cannot_do_is_not_amiss():
    assert noticed_s(lambda _: 0.1, lambda _: 0.0) is None


def test_without_reports_nothing_is_said_and_old_ones_do_not_count():
    assert noticed_s(lambda _: 0.5, lambda _: None) is None
    assert noticed_s(lambda t: 0.5 if t > 0.2 else 0.0, lambda t: 0.0 if t < 0.1 else None) is None
