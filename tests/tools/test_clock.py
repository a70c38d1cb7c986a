"""Clocks against one that the test moves."""

from __future__ import annotations

import numpy as np
import pytest

from tools.clock import PatientClock, RunClock


def test_a_run_has_one_offset():
    clock = RunClock()
    first, again = clock(), clock()
    assert again >= first
    assert abs(clock() - clock.offset_ns - clock.monotonic_ns()) < 1_000_000_000


class Moved:
    """Time that the test makes pass, in ms."""

    def __init__(self) -> None:
        self.now_ms = 5000

    def __call__(self) -> int:
        return self.now_ms * 1_000_000

    def pass_ms(self, ms: int) -> None:
        self.now_ms += ms


def test_a_patient_clock_keeps_pace_where_it_is_asked_often():
    time = Moved()
    clock = PatientClock(0.1, time)
    for _ in range(50):
        time.pass_ms(100)
        assert clock() == time()
    assert clock.waited_s == 0.0


def test_a_patient_clock_leaves_out_what_it_was_not_asked_for():
    time = Moved()
    clock = PatientClock(0.1, time)
    time.pass_ms(50)
    before = clock()
    time.pass_ms(3000)
    assert clock() == before + 100_000_000
    assert clock.waited_s == pytest.approx(2.9)
    time.pass_ms(20)
    assert clock() == before + 120_000_000


def test_times_of_a_patient_clock_are_found_on_the_other():
    time = Moved()
    clock = PatientClock(0.1, time)
    told, true = [], []
    for ms in (30, 700, 10, 90, 100, 250, 1):
        time.pass_ms(ms)
        told.append(clock())
        true.append(time())
    np.testing.assert_array_equal(clock.monotonic_ns(np.array(told)), true)
    between = np.linspace(told[0], told[-1], 1000).astype(np.int64)
    assert (np.diff(clock.monotonic_ns(between)) > 0).all()
