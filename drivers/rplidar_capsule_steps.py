"""How far the head turns from capsule to capsule: what inertia forbids is damage, or capsules that were lost."""

from __future__ import annotations

from numba import njit

from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray, Packets, is_restart, start_q6

BROKEN, RESTARTED = 1, 2
_SPEED_UP = 1.5  # between neighbouring capsules inertia forbids more: whole capsules were lost
_SPEED_UP_SLACK_Q6 = 2 * 64


@njit(cache=True, nogil=True)
def judge_steps(
    packets: Packets, known: int, before_q6: int, limit_q6: int, verdicts: IntArray
) -> tuple[bool, int, int]:
    """Judge the steps of P capsules but for the first `known`: verdicts (P - 1 - known,), 0 for a sound one.

    before_q6: the last sound step, -1 for none. Returns whether the head passed zero, how many steps are unsound, and
    the last sound one. RESTARTED: the later capsule's flag says that the device had lost track of its angle.
    """
    passes_zero, unsound = False, 0
    for place in range(known, len(packets) - 1):
        step = start_q6(packets, place + 1) - start_q6(packets, place)
        if step < 0:
            passes_zero = True
            step += FULL_TURN_Q6
        if is_restart(packets, place + 1):
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
