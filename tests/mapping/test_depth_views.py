from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from mapping.depth_grid import DepthGridBuilder
from mapping.depth_sensor_model import DepthModel
from mapping.depth_views import DepthViews, ViewSettings
from mapping.trajectory import Trajectory
from mapping.virtual_scan import VirtualScan

MS = 1_000_000


def scan(stamp_ns, range_m=2.0):
    """A wall straight across, as far as range_m."""
    angles = np.linspace(-0.6, 0.6, 200)
    ranges = range_m / np.cos(angles)
    return VirtualScan(stamp_ns, np.zeros(2), angles, ranges, np.full(200, 0.01), np.zeros(200), ranges)


def drive(views, stamps_ms, pose_at, every_ms=100, until_ms=3000):
    """Frames and poses as they come live: each pose a little late."""
    frames = [(stamp * MS, 1, stamp) for stamp in stamps_ms]
    poses = [(stamp * MS + 20 * MS, 0, stamp) for stamp in range(0, until_ms + 1, every_ms)]
    for _, is_frame, stamp in sorted(frames + poses):
        if is_frame:
            views.add_frame(stamp * MS, partial(scan, stamp * MS))
        else:
            views.add_pose(stamp * MS, np.asarray(pose_at(stamp * 1e-3), np.float64))
    views.finish()
    return views


def test_a_moving_car_takes_a_view_every_so_far():
    views = drive(DepthViews(ViewSettings(distance_m=0.1)), range(0, 3000, 33), lambda t: (0.5 * t, 0.0, 0.0))
    assert len(views) == pytest.approx(3.0 * 0.5 / 0.1, abs=3)
    assert views.counters.taken + views.counters.passed_over == views.counters.frames == 91


def test_a_turning_car_takes_a_view_every_so_much_turn():
    views = drive(DepthViews(ViewSettings(turn_rad=0.2)), range(0, 3000, 33), lambda t: (0.0, 0.0, t))
    assert len(views) == pytest.approx(3.0 / 0.2, abs=3)


def test_a_standing_car_takes_a_few_views_only():
    settings = ViewSettings(stand_s=0.3, most_standing=4)
    views = drive(DepthViews(settings), range(0, 60_000, 33), lambda t: (0.0, 0.0, 0.0), until_ms=60_000)
    assert len(views) == 4


def test_which_views_are_taken_does_not_depend_on_when_frames_came():
    stamps = range(0, 3000, 33)
    live = drive(DepthViews(ViewSettings()), stamps, lambda t: (0.3 * t, 0.0, 0.1 * t))
    late = DepthViews(ViewSettings(most_waiting=100))
    for stamp in range(0, 3001, 100):
        late.add_pose(stamp * MS, np.array([0.3e-3 * stamp, 0.0, 0.1e-3 * stamp]))
    for stamp in stamps:
        late.add_frame(stamp * MS, partial(scan, stamp * MS))
    model = DepthModel()
    way = Trajectory(np.array([0, 3000 * MS]), np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.3]]))
    first, second = (views.grid(way, 0.05, model) for views in (live, late))
    assert first.log_odds.tobytes() == second.log_odds.tobytes()


def test_scans_of_frames_that_are_not_taken_are_never_made():
    views = DepthViews(ViewSettings())
    views.add_pose(0, np.zeros(3))
    views.add_pose(1000 * MS, np.zeros(3))
    views.add_frame(0, lambda: scan(0))
    views.add_frame(MS, lambda: pytest.fail("was made"))
    assert (views.counters.taken, views.counters.passed_over) == (1, 1)


def test_frames_without_a_pose_are_counted():
    views = DepthViews(ViewSettings(most_waiting=3))
    views.add_pose(10 * MS, np.zeros(3))
    views.add_frame(5 * MS, lambda: scan(5 * MS))  # before the first pose
    for stamp in range(20, 25):
        views.add_frame(stamp * MS, lambda: pytest.fail("was made"))
    views.finish()
    assert (views.counters.unplaced, views.counters.dropped, views.counters.frames) == (4, 2, 6)


def test_the_map_is_drawn_at_the_poses_of_the_trajectory():
    """Loops that closed later have moved them: what counts is the trajectory in the end."""
    views = drive(DepthViews(ViewSettings()), range(0, 1000, 100), lambda t: (0.1 * t, 0.0, 0.0), until_ms=1000)
    moved = Trajectory(np.array([0, 1000 * MS]), np.array([[5.0, 1.0, 0.5], [5.1, 1.0, 0.5]]))
    builder = DepthGridBuilder(0.05, DepthModel())
    for view in views._views:
        builder.add_scan(moved.at(np.array([view.stamp_ns]))[0], view)
    assert np.array_equal(views.grid(moved, 0.05, DepthModel()).log_odds, builder.grid().log_odds)
    assert len(views) > 1


def test_nothing_is_drawn_where_the_trajectory_has_a_gap():
    views = drive(DepthViews(ViewSettings()), range(0, 3001, 100), lambda t: (t, 0.0, 0.0))
    gap = np.array([*range(0, 1001, 100), *range(2500, 3001, 100)])
    poses = np.stack([gap * 1e-3, 0.0 * gap, 0.0 * gap], axis=1)
    known = Trajectory(gap * MS, poses)
    grid = views.grid(known, 0.05, DepthModel())
    builder = DepthGridBuilder(0.05, DepthModel())
    for view in views._views:
        if view.stamp_ns <= 1000 * MS or view.stamp_ns >= 2500 * MS:
            builder.add_scan(known.at(np.array([view.stamp_ns]))[0], view)
    assert np.array_equal(grid.log_odds, builder.grid().log_odds)
    empty = views.grid(Trajectory(np.zeros(0, np.int64), np.zeros((0, 3))), 0.05, DepthModel())
    assert not empty.known.any()
