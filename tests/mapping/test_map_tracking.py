from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_tracking import MapLocaliser, MapTracker, TrackingSettings
from mapping.raycast import cast_rays
from mapping.reference_map import reference_map
from mapping.relocalisation import Located

CELL_M = 0.02
ORIGIN = np.array([3.0, -2.0, 0.4])


@pytest.fixture(scope="module")
def reference(room):
    log_odds = np.where(room, 3.0, -3.0).astype(np.float32)
    return reference_map(OccupancyGrid(log_odds, CELL_M, ORIGIN))


def points_at(room, pose, generator):
    headings = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    starts = np.repeat(pose[np.newaxis, :2] / CELL_M, 240, axis=0)
    ranges = cast_rays(room, starts, headings + pose[2], 12.0 / CELL_M) * CELL_M + generator.normal(0.0, 0.01, 240)
    return np.column_stack([np.cos(headings), np.sin(headings)]) * ranges[:, np.newaxis]


def circle(step: int) -> np.ndarray:
    """The true pose in the room's frame: a circle of 1.2 m, 0.05 m a step."""
    return se2.compose([4.0, 1.6, 0.0], se2.exp(np.array([0.05, 0.0, 0.05 / 1.2]) * step))


def found_at(T_room_base, T_odom_base) -> Located:
    T_map_base = se2.compose(ORIGIN, T_room_base)
    T_map_odom = se2.compose(T_map_base, se2.inverse(T_odom_base))
    return Located(0, T_map_base, T_map_odom, np.diag([0.05, 0.05, 0.02]) ** 2, 0.9, "told")


def drifting(step: int, share: float = 0.05) -> np.ndarray:
    """Odometry of the circle, too long and turning too far by a share."""
    return se2.exp(np.array([0.05, 0.0, 0.05 / 1.2]) * (1.0 + share) * step)


def test_the_track_holds_where_odometry_drifts(room, reference):
    generator = np.random.default_rng(1)
    tracker = MapTracker(
        reference, found_at(circle(0) + np.array([0.05, -0.04, 0.02]), drifting(0)), TrackingSettings()
    )
    for step in range(1, 200):
        T_odom_base = drifting(step)
        place = tracker.add(step, points_at(room, circle(step), generator), T_odom_base)
        error = se2.between(se2.compose(ORIGIN, circle(step)), place.T_map_base)
        assert np.hypot(*error[:2]) < 0.08
        assert abs(error[2]) < 0.03
        assert not place.by_odometry
        np.testing.assert_allclose(se2.compose(place.T_map_odom, T_odom_base), place.T_map_base, atol=1e-9)
    assert np.hypot(*se2.between(circle(0), se2.compose(circle(0), drifting(199)))[:2]) > 0.3


def test_a_track_that_no_scan_fits_is_lost_and_says_so(room, reference):
    generator = np.random.default_rng(1)
    tracker = MapTracker(reference, found_at(circle(0), drifting(0)), TrackingSettings(lost_m=1.0))
    wider = []
    for step in range(1, 80):
        rubbish = generator.uniform(-1.0, 1.0, (200, 2))
        place = tracker.add(step, rubbish, drifting(step))
        if place is None:
            break
        assert place.by_odometry
        wider.append(np.trace(place.covariance[:2, :2]))
    assert tracker.lost
    assert "lost after 1.0 m" in tracker.reason
    assert wider == sorted(wider)
    assert tracker.add(99, points_at(room, circle(step), generator), drifting(step)) is None


def test_a_lost_robot_is_found_again(room, reference):
    generator = np.random.default_rng(1)
    localiser = MapLocaliser(reference, tracking=TrackingSettings(lost_m=0.5))
    places = []
    for step in range(260):
        blind = 100 <= step < 112
        points = generator.uniform(-1.0, 1.0, (200, 2)) if blind else points_at(room, circle(step), generator)
        places.append(localiser.add(step, points, drifting(step, 0.005)))
    assert localiser.losses == 1
    assert places[99] is not None
    assert places[111] is None
    assert places[-1] is not None
    for step in (99, 259):
        error = se2.between(se2.compose(ORIGIN, circle(step)), places[step].T_map_base)
        assert np.hypot(*error[:2]) < 0.15


def into_the_room(step: int) -> np.ndarray:
    """The true pose: from the hall through the door, and round the room, 0.05 m a step."""
    inside = se2.exp(np.array([0.05, 0.0, 0.05 / 0.9]) * max(step - 30, 0))
    return se2.compose([4.9, 4.6 - 0.05 * min(step, 30), -np.pi / 2.0], inside)


def test_the_inner_faces_of_a_room_that_was_only_looked_into_are_not_taken_for_the_outer_ones(looked_into):
    cells, grid = looked_into
    generator = np.random.default_rng(1)
    T_odom_base = into_the_room(0)
    found = Located(0, T_odom_base, se2.IDENTITY, np.diag([0.05, 0.05, 0.02]) ** 2, 0.9, "told")
    tracker = MapTracker(reference_map(grid), found, TrackingSettings())
    for step in range(1, 150):
        truth = into_the_room(step)
        T_odom_base = se2.compose(T_odom_base, 1.01 * se2.between(into_the_room(step - 1), truth))
        place = tracker.add(step, points_at(cells, truth, generator), T_odom_base)
        error = se2.between(truth, place.T_map_base)
        assert np.hypot(*error[:2]) < 0.04
        assert error[:2] @ np.linalg.solve(place.covariance[:2, :2], error[:2]) < 9.0
    assert np.hypot(*se2.between(truth, T_odom_base)[:2]) > 0.06  # by odometry alone


def test_a_scan_of_which_the_map_knows_little_counts_little():
    cells = np.full((200, 200), -3.0, np.float32)
    cells[100] = 3.0  # one wall along x, at y = 5.025 m
    reference = reference_map(OccupancyGrid(cells, 0.05, np.zeros(3)))
    wall = np.column_stack([np.linspace(-1.5, 1.5, 100), np.full(100, 0.975)])  # 0.05 m nearer than predicted
    box = np.column_stack([np.linspace(-0.5, 0.5, 100), np.full(100, -1.0)])  # not on the map
    found = Located(0, np.array([5.0, 4.0, 0.0]), np.zeros(3), np.diag([0.05, 0.05, 0.02]) ** 2, 0.9, "told")
    corrections = []
    for seen in (wall, np.vstack([wall, box, box])):
        tracker = MapTracker(reference, found, TrackingSettings(step_m=0.0, min_hits=0.0, max_contradiction=1.0))
        corrections.append(tracker.add(1, seen, np.array([5.0, 4.0, 0.0])).T_map_base[1] - 4.0)
    assert corrections[0] == pytest.approx(0.05, abs=0.01)
    assert 0.0 < corrections[1] < 0.75 * corrections[0]
