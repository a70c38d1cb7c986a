from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.loop_closure import Closure
from mapping.scan_matching import Agreement
from tools.errors import ToolError
from tools.wrong_closures import agreeing_closures, random_closures

ANGLES = np.linspace(0.0, 2.0 * np.pi, 200)
CIRCLE = np.column_stack([10.0 * np.cos(ANGLES), 10.0 * np.sin(ANGLES), ANGLES + np.pi / 2])
REAL = tuple(
    Closure(0, 199, np.zeros(3), np.diag([weight, weight, 10.0 * weight]), 0.9, 0.3, Agreement(90, 2, 8))
    for weight in (400.0, 900.0)
)


def apart_m(closure: Closure) -> float:
    return float(np.hypot(*(CIRCLE[closure.first] - CIRCLE[closure.second])[:2]))


def test_random_ones_tie_far_places_with_the_certainty_of_real_ones() -> None:
    wrong = random_closures(CIRCLE, REAL, 50, seed=3)
    assert len(wrong) == 50
    assert all(closure.first < closure.second and apart_m(closure) > 4.0 for closure in wrong)
    assert {float(closure.information[0, 0]) for closure in wrong} == {400.0, 900.0}
    assert np.median([np.hypot(*closure.T_first_second[:2]) for closure in wrong]) < 1.0  # as if it were a revisit
    assert len({(closure.first, closure.second) for closure in wrong}) > 40


def test_a_group_is_explained_by_one_rigid_transform() -> None:
    wrong = agreeing_closures(CIRCLE, REAL, 10, seed=3)
    assert [closure.first - wrong[0].first for closure in wrong] == list(range(10))
    assert [closure.second - wrong[0].second for closure in wrong] == list(range(10))
    # Each says where the second stretch's frame would have to be moved: all say the same.
    moves = [
        se2.compose(se2.compose(CIRCLE[closure.first], closure.T_first_second), se2.inverse(CIRCLE[closure.second]))
        for closure in wrong
    ]
    np.testing.assert_allclose(moves, [moves[0]] * 10, atol=1e-9)
    second = CIRCLE[wrong[0].second]
    assert np.hypot(*(se2.compose(moves[0], second) - second)[:2]) > 3.0
    assert all(apart_m(closure) > 4.0 for closure in wrong)


@pytest.mark.parametrize("make", [random_closures, agreeing_closures])
def test_the_seed_decides(make) -> None:
    def pairs(seed: int) -> list[tuple[int, int]]:
        return [(closure.first, closure.second) for closure in make(CIRCLE, REAL, 10, seed)]

    assert pairs(1) == pairs(1)
    assert pairs(1) != pairs(2)


def test_a_drive_without_loops_or_without_distant_places_is_refused() -> None:
    with pytest.raises(ToolError, match="closes no loop"):
        random_closures(CIRCLE, (), 1, seed=0)
    with pytest.raises(ToolError, match="no two stretches of 10 keyframes"):
        agreeing_closures(CIRCLE[:12], REAL, 10, seed=0)
