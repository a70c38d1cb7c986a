from __future__ import annotations

import numpy as np
import pytest

from drivers.rplidar_sample_clock import SampleClock, packet_latency_s

SAMPLE_S = 125e-6


def feed(clock: SampleClock, delays_s: np.ndarray, first: int = 0, per_packet: int = 96, rate: float = 1.0) -> None:
    for packet, delay_s in enumerate(delays_s):
        last = first + (packet + 1) * per_packet - 1
        clock.observe(last, last * SAMPLE_S * rate + delay_s)


def test_delays_do_not_move_the_clock() -> None:
    clock = SampleClock(SAMPLE_S)
    delays = np.random.default_rng(1).uniform(0.001, 0.016, 400)
    delays[200:206] += 0.07
    feed(clock, delays)
    assert clock.times_s(400 * 96, 1)[0] - 400 * 96 * SAMPLE_S == pytest.approx(0.001, abs=0.001)


def test_a_slow_crystal_is_followed() -> None:
    clock = SampleClock(SAMPLE_S)
    feed(clock, np.zeros(5000), rate=1.0002)
    newest = 5000 * 96 - 1
    assert clock.times_s(newest, 1)[0] == pytest.approx(newest * SAMPLE_S * 1.0002, abs=1e-4)


@pytest.mark.parametrize("rate", [0.99, 1.01])
def test_a_wrong_nominal_period_stays_bounded(rate: float) -> None:
    clock = SampleClock(SAMPLE_S)
    feed(clock, np.zeros(5000), rate=rate)
    newest = 5000 * 96 - 1
    assert clock.times_s(newest, 1)[0] == pytest.approx(newest * SAMPLE_S * rate, abs=0.025)


def test_samples_lost_unseen_are_noticed() -> None:
    clock = SampleClock(SAMPLE_S)
    feed(clock, np.zeros(100))
    feed(clock, np.full(400, 0.05), first=9600)
    assert clock.times_s(9600, 1)[0] == pytest.approx(9600 * SAMPLE_S + 0.05, abs=0.002)


def test_restart_forgets() -> None:
    clock = SampleClock(SAMPLE_S)
    feed(clock, np.zeros(10))
    clock.restart()
    feed(clock, np.full(1, 3.0), first=960)
    assert clock.times_s(960, 1)[0] == pytest.approx(960 * SAMPLE_S + 3.0, abs=1e-6)


def test_latency_of_an_ultra_packet() -> None:
    # The oldest of 96 samples is 23.5 ms old when its packet has arrived at 115200 baud.
    assert packet_latency_s(SAMPLE_S, 132, 115200) + 95 * SAMPLE_S == pytest.approx(0.0235, abs=1e-4)
