from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from mapping.background import at_once
from mapping.front_end import KeyframeLink, TrackedScan
from mapping.graph_slam import GraphSettings, GraphSlam
from mapping.keyframes import KeyframeStore
from mapping.odometry import ScanMatch
from mapping.surface import surface_of

INFORMATION = np.diag([0.02**-2.0, 0.02**-2.0, 0.005**-2.0])
SETTINGS = GraphSettings()
MS = 1_000_000


class Driven:
    """A graph that is fed with scans at true poses (N, 3), each second a keyframe, as a front end that drifts does."""

    def __init__(self, site, truth: np.ndarray, settings: GraphSettings = SETTINGS, background=at_once) -> None:
        self.site, self.truth = site, truth
        self.store = KeyframeStore(np.zeros(2))
        self.graph = GraphSlam(settings, self.store, background)
        self.odom = truth[0]
        self.live: list[np.ndarray] = []
        self._keyframe_odom = truth[0]

    def feed(self, first: int, last: int, *, jump: np.ndarray | None = None) -> Driven:
        """Take in the scans first to last; jump: tracking was lost before them, and it is believed there."""
        for number in range(first, last):
            if number:
                x, y, yaw = se2.between(self.truth[number - 1], self.truth[number])
                step = np.array([1.02 * x, 1.02 * y, yaw + 0.008 * np.hypot(x, y)])
                self.odom = se2.compose(self.odom, step)
            if number == first and jump is not None:
                self.odom = jump
            points = self.site.look(self.truth[number], number)
            link = None
            if number % 2 == 0 or (number == first and jump is not None):
                connected = bool(len(self.store)) and not (number == first and jump is not None)
                T_previous_this = se2.between(self._keyframe_odom, self.odom)
                number_of_keyframe = self.store.add(surface_of(points, np.zeros(2)))
                link = KeyframeLink(number_of_keyframe, T_previous_this, INFORMATION, connected)
                self._keyframe_odom = self.odom
            match = ScanMatch(self.odom, se2.IDENTITY, accepted=True)
            self.live.append(self.graph.add(TrackedScan(100 * MS * number, match, points, False, link)))
        return self

    def finish(self) -> GraphSlam:
        self.graph.finish()
        return self.graph


@pytest.fixture(scope="module")
def scan_poses(lap_poses) -> np.ndarray:
    """Two scans a keyframe on the lap: (2 K, 3)."""
    between = se2.compose(lap_poses[:-1], se2.exp(0.5 * se2.log(se2.between(lap_poses[:-1], lap_poses[1:]))))
    poses = np.empty((2 * len(lap_poses) - 1, 3))
    poses[::2], poses[1::2] = lap_poses, between
    return poses


@pytest.fixture(scope="module")
def driven(building, scan_poses) -> Driven:
    """The whole lap, finished, not refined: only for reading."""
    lap = Driven(building, scan_poses).feed(0, len(scan_poses))
    lap.finish()
    return lap


def apart_m(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.hypot(*(one - other)[:, :2].T).max())


def inner_error(poses: np.ndarray, truth: np.ndarray) -> float:
    """How far the poses of the second round lie from where they are as the first round sees it."""
    first, second = slice(0, 40), slice(2 * 114, 2 * 114 + 40)
    return apart_m(se2.between(poses[first], poses[second]), se2.between(truth[first], truth[second]))


def test_a_loop_takes_the_drift_away(driven: Driven, building, scan_poses) -> None:
    open_loop = Driven(building, scan_poses, replace(SETTINGS, loop_closure=False)).feed(0, len(scan_poses)).finish()
    assert open_loop.counters.searches == 0
    assert inner_error(open_loop.trajectory().poses, scan_poses) > 0.7
    counters = driven.graph.counters
    assert counters.found == len(driven.graph.closures) >= 2
    assert (counters.withdrawn, counters.searches) == (0, len(driven.store) // 10 + 2)
    assert inner_error(driven.graph.trajectory().poses, scan_poses) < 0.06


def test_every_scan_has_its_pose_and_its_points(driven: Driven, scan_poses) -> None:
    trajectory, placed = driven.graph.trajectory(), driven.graph.placed_scans()
    assert len(trajectory) == len(placed) == len(scan_poses)
    np.testing.assert_array_equal(trajectory.stamps_ns, 100 * MS * np.arange(len(scan_poses)))
    np.testing.assert_array_equal(trajectory.poses, [pose for pose, _ in placed])
    np.testing.assert_allclose(trajectory.poses[::2], driven.graph.keyframe_poses, atol=1e-12)
    (segment,) = driven.graph.segments()
    assert (segment.start_ns, segment.scans, segment.in_map) == (0, len(scan_poses), True)


def test_poses_as_known_then_begin_where_odometry_does(driven: Driven, building, scan_poses) -> None:
    np.testing.assert_array_equal(driven.live[0], scan_poses[0])
    assert apart_m(np.array(driven.live[:200]), scan_poses[:200]) < 2.0
    assert driven.live[-1] == pytest.approx(driven.graph.trajectory().poses[-1], abs=0.3)


def test_a_search_in_a_thread_gives_the_same_bits(driven: Driven, building, scan_poses) -> None:
    with ThreadPoolExecutor(1) as pool:

        def in_a_thread(search):
            return pool.submit(search).result

        threaded = Driven(building, scan_poses, background=in_a_thread).feed(0, len(scan_poses))
        graph = threaded.finish()
    np.testing.assert_array_equal(np.array(threaded.live), np.array(driven.live))
    np.testing.assert_array_equal(graph.trajectory().poses, driven.graph.trajectory().poses)
    np.testing.assert_array_equal(graph.keyframe_poses, driven.graph.keyframe_poses)


def test_a_search_as_late_as_can_be_gives_the_same_bits(driven: Driven, building, scan_poses) -> None:
    """It runs when its outcome is asked for: what it was given must not have changed by then."""

    def at_last(search):
        return search

    late = Driven(building, scan_poses, background=at_last).feed(0, len(scan_poses))
    np.testing.assert_array_equal(late.finish().trajectory().poses, driven.graph.trajectory().poses)
    np.testing.assert_array_equal(np.array(late.live), np.array(driven.live))


def test_refinement_improves_the_map_and_a_cancelled_one_changes_nothing(building, scan_poses) -> None:
    graph = Driven(building, scan_poses).feed(0, len(scan_poses)).finish()
    before = graph.trajectory().poses
    asked: list[int] = []

    def when_asked_for_the(nth: int) -> Callable[[], bool]:
        asked.clear()

        def cancelled() -> bool:
            asked.append(nth)
            return len(asked) == nth

        return cancelled

    for nth in (4, 8):  # among the keyframes' sweeps, and among the scans
        assert graph.refine(when_asked_for_the(nth)) is False
        np.testing.assert_array_equal(graph.trajectory().poses, before)
    assert graph.refine() is True
    after = graph.trajectory().poses
    assert inner_error(after, scan_poses) < 0.5 * inner_error(before, scan_poses)
    assert inner_error(after, scan_poses) < 0.03


def test_a_refined_map_stays_refined_whatever_is_optimised_later(building, scan_poses) -> None:
    graph = Driven(building, scan_poses).feed(0, len(scan_poses)).finish()
    assert graph.refine()
    refined = graph.keyframe_poses.copy()
    graph.finish()  # searches and optimises once more, as the next drive on this map would
    assert apart_m(graph.keyframe_poses, refined) < 0.005


def test_on_the_way_the_map_is_refined_each_time_the_drive_has_doubled(building, scan_poses) -> None:
    early = replace(SETTINGS, first_refinement=40)
    graph = Driven(building, scan_poses, early).feed(0, len(scan_poses)).finish()
    assert graph.counters.refinements == int(np.log2(len(graph.keyframe_poses) / 40)) + 1
    never = replace(SETTINGS, refine_on_the_way=False)
    plain = Driven(building, scan_poses, never).feed(0, len(scan_poses)).finish()
    assert plain.counters.refinements == 0
    first = slice(0, 100)  # of scans, refined by the time that the drive ends
    assert apart_m(*(se2.between(each[first][0], each[first]) for each in (graph.trajectory().poses, scan_poses))) < (
        0.6 * apart_m(*(se2.between(each[first][0], each[first]) for each in (plain.trajectory().poses, scan_poses)))
    )


def test_refining_a_copy_with_more_closures_leaves_the_graph_as_it_is(building, scan_poses) -> None:
    graph = Driven(building, scan_poses).feed(0, len(scan_poses)).finish()
    before = {name: values.copy() for name, values in graph.state().arrays.items()}
    assert graph.with_closures(()).refine()
    for name, values in graph.state().arrays.items():
        np.testing.assert_array_equal(values, before[name], err_msg=name)


# Pieces of the drive


@pytest.mark.parametrize("turn", [0.5, 3.1])
def test_a_lost_robot_is_tied_to_the_map_where_it_is(turn: float, building, scan_poses) -> None:
    """A drive over half the lap, a loss, and on from the beginning: the robot believes to be anywhere else."""
    again = np.vstack([scan_poses[:150], scan_poses[20:110]])
    driven = Driven(building, again).feed(0, 150).feed(150, 240, jump=np.array([25.0, -3.0, turn]))
    graph = driven.finish()
    assert [(segment.scans, segment.in_map) for segment in graph.segments()] == [(150, True), (90, True)]
    assert graph.is_tied
    assert graph.refine()
    poses = graph.trajectory().poses
    assert len(poses) == 240
    assert apart_m(se2.between(poses[20:110], poses[150:]), np.zeros((90, 3))) < 0.04


def test_a_lost_robot_in_an_unknown_place_is_left_out(building, scan_poses, room, site) -> None:
    unrefined = replace(SETTINGS, refine_on_the_way=False)
    driven = Driven(building, scan_poses[:150], unrefined).feed(0, 150)
    alone = driven.graph.keyframe_poses.copy()
    elsewhere = np.column_stack([np.linspace(2.0, 6.0, 60), np.full(60, 2.0), np.zeros(60)])
    driven.site, driven.truth = site(room), np.vstack([scan_poses[:150], elsewhere])
    driven.feed(150, 210, jump=np.array([8.0, 5.0, 0.1]))
    graph = driven.finish()
    assert [(segment.scans, segment.in_map) for segment in graph.segments()] == [(150, True), (60, False)]
    assert not graph.is_tied
    assert len(graph.trajectory()) == len(graph.placed_scans()) == 150
    np.testing.assert_allclose(graph.keyframe_poses[: len(alone)], alone, atol=1e-9)
    assert graph.refine()
    assert len(graph.trajectory()) == 150


# What is taken back, and what is nothing


def test_retracted_scans_are_forgotten(building, scan_poses) -> None:
    driven = Driven(building, scan_poses[:20]).feed(0, 10)
    points = building.look(scan_poses[10], 10)
    match = ScanMatch(driven.odom, se2.IDENTITY, accepted=True)
    driven.graph.add(TrackedScan(850 * MS, match, points, False, None, retracted=2))
    stamps = driven.graph.trajectory().stamps_ns
    assert stamps.tolist() == [*(100 * MS * np.arange(8)).tolist(), 850 * MS]


@pytest.mark.parametrize("by_wheels", [True, False], ids=["carried by wheels", "blind"])
def test_scans_that_did_not_match_are_placed_by_wheels_only_and_not_drawn(by_wheels, building, scan_poses) -> None:
    driven = Driven(building, scan_poses[:4]).feed(0, 4)
    refused = ScanMatch(driven.odom, se2.IDENTITY, accepted=False, reason="too few measurements")
    driven.graph.add(TrackedScan(400 * MS, refused, np.ones((5, 2)), by_wheels, None))
    assert len(driven.graph.trajectory()) == 4 + by_wheels
    assert len(driven.graph.placed_scans()) == 4


def test_nothing_is_no_map() -> None:
    graph = GraphSlam(SETTINGS, KeyframeStore(np.zeros(2)))
    graph.finish()
    assert graph.refine()
    assert (len(graph.trajectory()), graph.segments(), graph.placed_scans()) == (0, [], [])
    match = ScanMatch(np.array([1.0, 2.0, 0.5]), se2.IDENTITY, accepted=False)
    pose = graph.add(TrackedScan(5, match, np.zeros((0, 2)), False, None))
    np.testing.assert_array_equal(pose, match.pose)
    assert len(graph.trajectory()) == 0
