from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from mapping.loop_closure import Closure, Drive, LoopSettings, close_loops, constraints_of, find_closures, settle
from mapping.pose_graph import Constraints
from mapping.scan_matching import Agreement
from mapping.surface import surface_of

SETTINGS = LoopSettings()
INFORMATION = np.diag([0.02**-2.0, 0.02**-2.0, 0.005**-2.0])
LOST = np.diag([1e-6, 1e-6, 1e-4])


def drive_of(site, truth: np.ndarray, drift: tuple[float, float] = (1.0, 0.0), segments=None) -> Drive:
    """A drive with keyframes at truth (K, 3); odometry scales metres and adds radians a metre, from the first on."""
    steps = se2.between(truth[:-1], truth[1:])
    steps = steps * [drift[0], drift[0], 1.0] + np.hypot(*steps[:, :2].T)[:, None] * [0.0, 0.0, drift[1]]
    poses = [truth[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    segments = np.zeros(len(truth), np.int64) if segments is None else segments
    count = len(steps)
    information = np.where((np.diff(segments) > 0)[:, None, None], LOST, INFORMATION)
    constraints = Constraints(np.arange(count), np.arange(1, count + 1), steps, information, np.zeros(count, np.bool_))
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*steps[:, :2].T))])
    return Drive(site.keyframes(truth).snapshot(), np.array(poses), travelled, segments, constraints, ())


def off_m(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.hypot(*(poses - truth)[:, :2].T).max())


@pytest.fixture(scope="module")
def lap(building, lap_poses) -> Drive:
    """The lap with 2 % too long steps and 0.5 deg a metre: about a metre off after it."""
    return drive_of(building, lap_poses, (1.02, 0.008))


def test_a_revisited_place_is_found_and_the_drift_taken_away(lap: Drive, lap_poses) -> None:
    query = len(lap_poses) - 1 - SETTINGS.half_group
    assert off_m(lap.poses, lap_poses) > 0.8
    outcome = close_loops(lap, query, SETTINGS)
    assert outcome.found == len(outcome.closures) >= 1
    for closure in outcome.closures:
        off = se2.between(se2.between(lap_poses[closure.first], lap_poses[closure.second]), closure.T_first_second)
        assert np.hypot(off[0], off[1]) < 0.03
        assert abs(off[2]) < np.radians(0.5)
        assert closure.second == query
        assert closure.rival < SETTINGS.most_rival * closure.score
    # The odometry of the first metres is 2 % too long: only the rest can be taken away.
    assert off_m(outcome.poses[query:], lap_poses[query:]) < 0.3 * off_m(lap.poses[query:], lap_poses[query:])
    before = int(outcome.closures[0].first)
    apart = se2.between(outcome.poses[before], outcome.poses[query]) - se2.between(lap_poses[before], lap_poses[query])
    assert np.hypot(apart[0], apart[1]) < 0.05
    assert len(outcome.poses) == len(lap.poses)


def test_a_place_seen_for_the_first_time_is_no_loop(lap: Drive) -> None:
    for query in (20, 50, 70, 95):
        outcome = close_loops(lap, query, SETTINGS)
        assert (outcome.found, outcome.closures) == (0, ())
        np.testing.assert_array_equal(outcome.poses, lap.poses)


def test_what_was_just_driven_is_no_loop(lap: Drive) -> None:
    assert find_closures(lap, 120, replace(SETTINGS, least_path_m=40.0)) == ([], 0)


def test_a_surprise_needs_a_second_piece_of_the_drive_that_agrees(lap: Drive, lap_poses) -> None:
    query = len(lap_poses) - 1 - SETTINGS.half_group
    surprised = replace(SETTINGS, surprise_m=0.0)
    believed, unconfirmed = find_closures(lap, query, surprised)
    assert len(believed) >= 1
    nothing_agrees = replace(surprised, agree_m=0.0)
    assert find_closures(lap, query, nothing_agrees) == ([], len(believed) + unconfirmed)


def test_look_alike_rooms_are_not_one(carved, site) -> None:
    """Two rooms alike to the last cell, 8 m apart, and odometry that may be off by as much."""
    rooms = [(x, y0, x + 4.0, y0 + 3.4) for x, y0 in ((1.0, 3.4), (9.0, 3.4))]
    doors = [(x + 1.6, 3.0, x + 2.6, 3.4) for x in (1.0, 9.0)]
    niches = [(2.0, 0.6, 3.5, 1.0), (6.0, 0.4, 6.6, 1.0), (7.2, 0.2, 9.4, 1.0)]
    place = site(carved(15.0, 7.2, (0.6, 1.0, 14.4, 3.0), *rooms, *doors, *niches))
    legs = [((1.0, 2.0), (3.1, 2.0)), ((3.1, 2.0), (3.1, 5.6)), ((3.1, 5.6), (3.1, 2.0)), ((3.1, 2.0), (11.1, 2.0)),
            ((11.1, 2.0), (11.1, 5.6)), ((11.1, 5.6), (11.1, 4.0))]  # fmt: skip
    truth = np.vstack([between_points(*leg) for leg in legs])
    drive = drive_of(place, truth)
    generous = replace(SETTINGS, first_drift_m=8.0)
    in_second_room = np.flatnonzero((truth[:, 0] > 9.0) & (truth[:, 1] > 3.6))
    for query in in_second_room[::4]:
        for closure in find_closures(drive, int(query), generous)[0]:
            off = se2.between(se2.between(truth[closure.first], truth[closure.second]), closure.T_first_second)
            assert np.hypot(off[0], off[1]) < 0.1
    assert len(in_second_room) > 12


def between_points(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """Poses (N, 3) each 0.25 m from start to end, looking ahead."""
    away = np.subtract(end, start)
    shares = np.arange(0.0, 1.0, 0.25 / np.hypot(*away))[:, None]
    return np.column_stack([start + shares * away, np.full(len(shares), np.arctan2(away[1], away[0]))])


# Pieces of a drive between which tracking was lost


def segmented(building, lap_poses, moved: np.ndarray) -> Drive:
    """The lap, whose last 36 keyframes are a piece of their own, put elsewhere."""
    segments = (np.arange(len(lap_poses)) >= len(lap_poses) - 36).astype(np.int64)
    drive = drive_of(building, lap_poses, segments=segments)
    poses = drive.poses.copy()
    poses[-36:] = se2.compose(moved, poses[-36:])
    steps = drive.steps
    measured = steps.T_first_second.copy()
    measured[-36] = se2.between(poses[-37], poses[-36])
    return replace(drive, poses=poses, steps=replace(steps, T_first_second=measured))


@pytest.mark.parametrize("moved", [[3.0, 5.0, 0.4], [-20.0, 4.0, 3.0], [0.0, 0.0, -1.6]])
def test_a_lost_piece_is_tied_to_the_map_at_its_right_place(moved, building, lap_poses) -> None:
    drive = segmented(building, lap_poses, np.array(moved))
    assert drive.components().tolist() == [0] * (len(lap_poses) - 36) + [1] * 36
    outcome = close_loops(drive, len(lap_poses) - 1 - SETTINGS.half_group, SETTINGS)
    assert outcome.found >= 1
    assert not replace(drive, closures=outcome.closures).components().any()
    off = se2.between(lap_poses, outcome.poses)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert np.abs(off[:, 2]).max() < 0.02


def test_a_lost_piece_in_an_unknown_place_is_left_out(building, room, site, lap_poses) -> None:
    elsewhere = np.column_stack([np.linspace(2.0, 6.0, 20), np.full(20, 2.0), np.zeros(20)])
    known, unknown = drive_of(building, lap_poses[:60]), drive_of(site(room), elsewhere)
    store = building.keyframes(lap_poses[:60])
    for number, pose in enumerate(elsewhere):
        store.add(surface_of(site(room).look(pose, number), np.zeros(2)))
    joint = constraints_between(known, unknown)
    outcome = close_loops(replace(joint, clouds=store.snapshot()), 70, SETTINGS)
    assert outcome.found == 0
    np.testing.assert_array_equal(outcome.poses, joint.poses)


def constraints_between(one: Drive, other: Drive) -> Drive:
    """One drive after the other, with a loss in between."""
    count = len(one.poses)
    lost = Constraints(
        np.array([count - 1]), np.array([count]), se2.between(one.poses[-1:], other.poses[:1]), LOST[None],
        np.zeros(1, np.bool_),
    )  # fmt: skip
    later = replace(other.steps, first=other.steps.first + count, second=other.steps.second + count)
    return Drive(
        one.clouds, np.vstack([one.poses, other.poses]),
        np.concatenate([one.travelled, one.travelled[-1] + other.travelled]),
        np.repeat([0, 1], [count, len(other.poses)]), one.steps.joined(lost).joined(later), (),
    )  # fmt: skip


# The graph


def closure_between(truth: np.ndarray, first: int, second: int, off=(0.0, 0.0, 0.0)) -> Closure:
    measured = se2.compose(se2.between(truth[first], truth[second]), off)
    return Closure(first, second, measured, INFORMATION, 0.9, 0.3, Agreement(90, 1, 9))


def test_closures_become_robust_constraints(lap_poses) -> None:
    both = constraints_of((closure_between(lap_poses, 3, 118), closure_between(lap_poses, 5, 120)))
    assert (both.first.tolist(), both.second.tolist(), both.robust.tolist()) == ([3, 5], [118, 120], [True, True])
    assert len(constraints_of(())) == 0


def test_settling_follows_right_closures_and_doubts_a_wrong_one(lap: Drive, lap_poses) -> None:
    right = tuple(closure_between(lap_poses, first, first + 114) for first in (2, 8, 14, 20))
    wrong = closure_between(lap_poses, 40, 100, (2.0, -1.0, 0.3))
    good, doubted = settle(lap, right, SETTINGS, 20), settle(lap, (*right, wrong), SETTINGS, 20)
    assert off_m(doubted, good) < 0.1
    assert off_m(good[114:], lap_poses[114:]) < 0.15
