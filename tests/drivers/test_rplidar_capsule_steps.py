from __future__ import annotations

import numpy as np

from drivers.rplidar_capsule_steps import BROKEN, RESTARTED, judge_steps
from drivers.rplidar_capsules import start_q6
from drivers.rplidar_encoding import encode_dense


def judged(start_q6_of: list[int], restarts: list[int] | None = None, before_q6: int = -1, known: int = 0):
    flags = np.isin(np.arange(len(start_q6_of)), restarts or [])
    packets = encode_dense(np.array(start_q6_of), np.zeros((len(start_q6_of), 40), dtype=np.int64), flags)
    verdicts = np.zeros(len(start_q6_of) - 1 - known, dtype=np.int64)
    passes, unsound, last = judge_steps(packets.tobytes(), 84, known, before_q6, 5000, verdicts)
    assert unsound == np.count_nonzero(verdicts)
    assert start_q6(packets, len(packets) - 1) == start_q6_of[-1]
    return verdicts.tolist(), passes, last


def test_even_steps_over_zero_are_sound() -> None:
    assert judged([22000, 22900, 760, 1660]) == ([0, 0, 0], True, 900)


def test_a_step_twice_as_long_says_that_one_is_missing() -> None:
    assert judged([0, 900, 2700, 3600]) == ([0, BROKEN, 0], False, 900)


def test_no_step_is_longer_than_the_head_can_turn() -> None:
    assert judged([0, 5001]) == ([BROKEN], False, -1)


def test_the_step_before_a_call_counts() -> None:
    assert judged([0, 2000], before_q6=900) == ([BROKEN], False, -1)
    assert judged([0, 2000, 2900], before_q6=900, known=1) == ([0], False, 900)


def test_a_restart_is_no_step() -> None:
    assert judged([0, 900, 20000, 20900], restarts=[2]) == ([0, RESTARTED, 0], False, 900)
