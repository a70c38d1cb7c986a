from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping import se2
from mapping.keyframes import KeyframeStore
from mapping.scan_matching import Group, GroupMatch, group_agreement, match_groups
from mapping.surface import surface_of

GATES_M = (0.3, 0.2, 0.1, 0.1)
FIXED = np.array([[1.0, 1.5, 0.2], [1.4, 1.5, 0.4], [1.8, 1.7, 0.6]])
MOVING = np.array([[4.0, 2.6, 2.2], [4.2, 2.4, 2.0], [4.4, 2.1, 1.8], [4.5, 1.8, 1.6]])


def group(numbers, poses, center: int = 0) -> Group:
    return Group(np.asarray(numbers, dtype=np.int64), se2.between(poses[center], poses))


@pytest.fixture(scope="module")
def clouds(room, site):
    """What is seen from the fixed poses (numbers 0 to 2) and from the moving ones (3 to 6)."""
    return site(room).keyframes(np.vstack([FIXED, MOVING])).snapshot()


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.05, 0.05), st.integers(0, 3))
@settings(max_examples=20)
def test_a_known_transform_is_recovered(clouds, dx: float, dy: float, turn: float, center: int) -> None:
    truth = se2.between(FIXED[0], MOVING[center])
    match = match_groups(
        clouds,
        group([3, 4, 5, 6], MOVING, center),
        group([0, 1, 2], FIXED),
        se2.compose(truth, [dx, dy, turn]),
        GATES_M,
    )
    off = se2.between(truth, match.pose)
    # 1 cm of noise, cells of 2 cm, some hundred samples of each wall.
    assert np.hypot(off[0], off[1]) < 0.012
    assert abs(off[2]) < np.radians(0.3)
    assert match.is_pinned_down
    assert match.pairs > 1000
    assert match.rms_m < 0.02


def test_two_groups_match_one_another_as_inverses(clouds) -> None:
    one, other = group([0, 1, 2], FIXED), group([3, 4, 5, 6], MOVING)
    guess = se2.between(FIXED[0], MOVING[0])
    forth = match_groups(clouds, other, one, guess, GATES_M)
    back = match_groups(clouds, one, other, se2.inverse(guess), GATES_M)
    np.testing.assert_allclose(se2.compose(forth.pose, back.pose), np.zeros(3), atol=0.01)


def test_the_stated_information_is_the_curvature_of_what_is_minimised(clouds) -> None:
    """A prior that pulls the pose away from its best place tells how stiff the walls are."""
    one, other = group([0, 1, 2], FIXED), group([3, 4, 5, 6], MOVING)
    best = match_groups(clouds, other, one, se2.between(FIXED[0], MOVING[0]), (0.3,) * 8)
    prior, away = np.diag([3e5, 5e5, 8e5]), np.array([0.02, -0.015, 0.005])
    pulled = match_groups(clouds, other, one, best.pose + away, (0.3,) * 8, prior=prior)
    settled = np.linalg.solve(best.information + prior, prior @ away)
    np.testing.assert_allclose(pulled.pose - best.pose, settled, atol=0.15 * np.abs(settled).max())


@pytest.fixture(scope="module")
def corridor(carved, site):
    """Two looks along a plain corridor 2 m wide, whose ends are out of sight, and where they were taken."""
    place = site(carved(40.0, 3.0, (0.5, 0.5, 39.5, 2.5)), 360, 0.01)
    poses = np.array([[20.0, 1.4, 0.0], [20.3, 1.5, 1.1]])
    return place.keyframes(poses).snapshot(), poses


def test_a_plain_corridor_is_not_pinned_down(corridor) -> None:
    clouds, poses = corridor
    truth = se2.between(*poses)
    match = match_groups(clouds, group([1], poses[1:]), group([0], poses[:1]), truth, GATES_M)
    assert not match.is_pinned_down
    assert match.pose[1:] == pytest.approx(truth[1:], abs=0.01)
    information = match.information_with()
    # In the frame of the moving scan, which stands at 1.1 rad, the corridor runs along -1.1 rad.
    along, across = np.array([np.cos(1.1), -np.sin(1.1), 0.0]), np.array([np.sin(1.1), np.cos(1.1), 0.0])
    assert along @ information @ along < 0.02 * (across @ information @ across)
    assert across @ information @ across > 0.05**-2
    assert 1.0 / np.sqrt(along @ information @ along) > 0.1


def test_a_prior_keeps_a_corridor_from_sliding(corridor) -> None:
    clouds, poses = corridor
    truth = se2.between(*poses)
    guess = np.add(truth, [0.0, 0.08, 0.01])
    prior = np.diag([0.03**-2.0, 0.03**-2.0, 0.01**-2.0])
    match = match_groups(clouds, group([1], poses[1:]), group([0], poses[:1]), guess, GATES_M, prior=prior)
    assert match.pose == pytest.approx(truth, abs=0.015)
    free, held = match.information_with(), match.information_with(prior)
    assert np.all(np.linalg.eigvalsh(held) >= np.linalg.eigvalsh(free) * (1.0 - 1e-9))
    assert np.linalg.eigvalsh(held)[0] > 0.05**-2


@given(st.floats(-np.pi, np.pi), st.floats(0.0, 1.0), st.floats(1.0, 1e6))
def test_information_is_symmetric_positive_and_never_better_than_the_floor(
    yaw: float, share: float, most: float
) -> None:
    match = GroupMatch(np.array([1.0, 2.0, yaw]), np.diag([most, share * most, most]), 100, 0.01)
    information = match.information_with()
    np.testing.assert_allclose(information, information.T, rtol=1e-6, atol=1e-6)
    values = np.linalg.eigvalsh(information)
    assert values[0] > 0.0
    assert 1.0 / np.sqrt(np.linalg.eigvalsh(information[:2, :2])[1]) > 0.0199
    assert information[2, 2] < 0.005**-2.0


def test_groups_that_see_nothing_of_each_other_stay_where_they_were_guessed(clouds) -> None:
    guess = np.array([50.0, -20.0, 1.0])
    match = match_groups(clouds, group([3], MOVING[:1]), group([0], FIXED[:1]), guess, GATES_M)
    assert (match.pairs, match.rms_m) == (0, 0.0)
    np.testing.assert_array_equal(match.pose, guess)
    assert not match.is_pinned_down


# Agreement


def test_groups_agree_where_they_belong_and_contradict_elsewhere(clouds) -> None:
    one, other = group([0, 1, 2], FIXED), group([3, 4, 5, 6], MOVING)
    truth = se2.between(FIXED[0], MOVING[0])
    right = group_agreement(clouds, other, one, truth, 0.1)
    assert right.hit_share > 0.97
    assert right.overlap > 0.6
    wrong = group_agreement(clouds, other, one, se2.compose(truth, [0.5, 0.5, 0.3]), 0.1)
    assert wrong.hit_share < 0.8
    assert wrong.hits + wrong.conflicts + wrong.hidden == right.hits + right.conflicts + right.hidden


def test_agreement_is_mutual(clouds) -> None:
    one, other = group([0, 1, 2], FIXED), group([3, 4, 5, 6], MOVING)
    pose = se2.compose(se2.between(FIXED[0], MOVING[0]), [0.1, 0.2, 0.1])
    forth = group_agreement(clouds, other, one, pose, 0.1)
    back = group_agreement(clouds, one, other, se2.inverse(pose), 0.1)
    assert (forth.hits, forth.conflicts, forth.hidden) == (back.hits, back.conflicts, back.hidden)


def test_agreement_of_empty_scans_is_no_agreement() -> None:
    store = KeyframeStore(np.zeros(2))
    store.add(surface_of(np.zeros((0, 2)), np.zeros(2)))
    empty = Group(np.zeros(1, np.int64), np.zeros((1, 3)))
    agreed = group_agreement(store.snapshot(), empty, empty, np.zeros(3), 0.1)
    assert (agreed.hits, agreed.hit_share, agreed.overlap) == (0, 0.0, 0.0)
