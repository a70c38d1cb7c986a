"""How far the head turns from capsule to capsule: what inertia forbids is damage, or capsules that were lost."""

from __future__ import annotations

import numpy as np
from numba import njit

from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray

BROKEN, RESTARTED = 1, 2
_SPEED_UP = 1.5  # between neighbouring capsules inertia forbids more: whole capsules were lost
_SPEED_UP_SLACK_Q6 = 2 * 64
_RESTART = 0x8000  # the first capsule after a start or after lost angle tracking; not a new turn


@njit(cache=True, nogil=True)
def judge_steps(
    capsules: bytes, size: int, known: int, before_q6: int, limit_q6: int, verdicts: IntArray
) -> tuple[bool, int, int]:
    """Judge the steps of P capsules of a size but for the first `known`: verdicts (P - 1 - known,), 0 for a sound one.

    before_q6: the last sound step, -1 for none. Returns whether the head passed zero, how many steps are unsound, and
    the last sound one. RESTARTED: the later capsule's flag says that the device had lost track of its angle.
    """
    passes_zero, unsound = False, 0
    for place in range(known, len(capsules) // size - 1):
        here, behind = _start_word(capsules, place * size), _start_word(capsules, (place + 1) * size)
        step = (behind & 0x7FFF) - (here & 0x7FFF)
        if step < 0:
            passes_zero = True
            step += FULL_TURN_Q6
        if behind & _RESTART:
            verdicts[place - known] = RESTARTED
            unsound += 1
            continue
        before = step if before_q6 < 0 else before_q6
        faster, slower = max(step, before), min(step, before)
        if step > limit_q6 or faster > _SPEED_UP * slower + _SPEED_UP_SLACK_Q6:
            verdicts[place - known] = BROKEN
            unsound += 1
            before_q6 = -1
        else:
            before_q6 = step
    return passes_zero, unsound, before_q6


@njit(cache=True, nogil=True)
def _start_word(capsules: bytes, at: int) -> int:
    """Return start angle and restart flag of the capsule that begins here."""
    word: int = np.int64(capsules[at + 2]) | np.int64(capsules[at + 3]) << 8
    return word
