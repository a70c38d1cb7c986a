"""The default registration: right, refused with the reason, or ambiguous; never a coin toss."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.layered import LayeredSettings, register_layers
from fusion.resampling import raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid

FRAME = np.array([3.0, -7.0, 2.1])
CELL_M = 0.05


def pose_of(found: Alignment) -> np.ndarray:
    """The pose of an alignment that must have one."""
    assert found.T_a_b is not None, found.reason
    return found.T_a_b


def off_by(found: Alignment, truth: np.ndarray, point_b: np.ndarray) -> float:
    """How far a point of map b is put from where it belongs."""
    return float(np.hypot(*(se2.transform_points(pose_of(found), point_b) - se2.transform_points(truth, point_b))))


def redrawn(grid: OccupancyGrid, T_new_old: np.ndarray) -> OccupancyGrid:
    """The map drawn anew in another frame."""
    rows, cols = grid.log_odds.shape
    corners = np.array([(0.0, 0.0), (cols, 0.0), (cols, rows), (0.0, rows)]) * grid.resolution_m
    raster = raster_around(se2.transform_points(T_new_old, corners), grid.resolution_m)
    return OccupancyGrid(resample(grid, T_new_old, raster), grid.resolution_m, raster.origin)


def corridor(length_m: float, doors: bool = True) -> OccupancyGrid:
    """A corridor 2 m wide that goes on at both ends; doors every 4 m."""
    cols = round(length_m / CELL_M)
    cells = np.zeros((60, cols), np.float32)
    cells[10:51] = -4.0
    cells[[10, 50]] = 4.0
    if doors:
        for col in range(40, cols - 20, 80):
            cells[[10, 50], col : col + 18] = -4.0
            cells[5:10, col : col + 18] = cells[51:56, col : col + 18] = -4.0
    return OccupancyGrid(cells, CELL_M, np.zeros(3))


@pytest.mark.parametrize("resolution_m", [0.05, 0.1])
def test_two_views_of_a_building_are_joined_below_a_cell(view, resolution_m):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(8.0, 30.0, FRAME, 2, resolution_m)
    found = register_layers(a, b)
    truth = se2.inverse(FRAME)
    middle = se2.transform_points(FRAME, np.array([14.0, 9.0]))
    assert found.accepted, found.reason
    assert off_by(found, truth, middle) < 0.03
    error = pose_of(found) - truth
    error[2] = se2.wrap_angle(error[2])
    assert abs(np.degrees(error[2])) < 0.1
    assert found.covariance is not None
    assert error @ np.linalg.solve(found.covariance, error) < 11.3
    assert found.probability is not None
    assert found.probability > 0.9
    assert found.overlap == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "accepted"),
    [
        (LayeredSettings(accept=1.1, accept_clear=1.1), False),
        (LayeredSettings(accept=1.1, long_wall_m=1e3, clear_areas=1.1), False),
        (LayeredSettings(accept=1.1, long_wall_m=1e3), True),
        (LayeredSettings(accept=1.1, clear_areas=1.1), True),
    ],
    ids=["never", "little wall and areas that contradict", "areas agree", "much wall"],
)
def test_much_wall_or_areas_that_agree_lower_what_a_pose_must_reach(view, settings, accepted):
    found = register_layers(view(0.0, 20.0, np.zeros(3), 1), view(8.0, 30.0, FRAME, 2), settings)
    assert found.common_wall_m is not None
    assert found.common_wall_m >= LayeredSettings().long_wall_m
    assert found.acceptance >= LayeredSettings().clear_areas
    assert found.accepted is accepted, found.reason


def test_exchanging_the_maps_gives_the_inverse_and_the_same_verdict(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(8.0, 30.0, FRAME, 2)
    there, back = register_layers(a, b), register_layers(b, a)
    np.testing.assert_allclose(se2.compose(pose_of(there), pose_of(back)), np.zeros(3), atol=1e-12)
    assert (there.accepted, there.probability, there.reason) == (back.accepted, back.probability, back.reason)
    assert back.inverse().covariance == pytest.approx(there.covariance)


def test_the_same_maps_give_the_same_result_bit_for_bit(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(12.0, 30.0, FRAME, 2)
    first, second = register_layers(a, b, seed=3), register_layers(a, b, seed=3)
    assert pose_of(first).tobytes() == pose_of(second).tobytes()
    assert (first.probability, first.reason) == (second.probability, second.reason)


def test_parts_that_share_nothing_are_refused(view):
    found = register_layers(view(0.0, 9.0, np.zeros(3), 1), view(19.5, 30.0, FRAME, 2))
    assert not found.accepted
    assert found.probability is not None
    assert found.probability < 0.9


def test_a_repeating_corridor_is_not_a_coin_toss():
    a, b = corridor(40.0), corridor(16.0)
    found = register_layers(a, redrawn(b, FRAME))
    assert not found.accepted
    assert found.ambiguous, found.reason
    middle = se2.transform_points(FRAME, np.array([8.0, 1.5]))
    places = [se2.transform_points(pose, middle) for pose in (pose_of(found), found.alternatives[0].T_a_b)]
    assert np.hypot(*(places[0] - places[1])) > 1.0 or "turned by 180 deg" in found.reason


def test_a_plain_corridor_slides():
    found = register_layers(corridor(30.0, doors=False), redrawn(corridor(20.0, doors=False), FRAME))
    assert not found.accepted


def test_a_symmetric_floor_is_ambiguous_and_both_places_are_listed(building):
    half = building.log_odds[:, :300]
    cells = np.hstack([half, half[::-1, ::-1]])  # looks the same after half a turn
    symmetric = OccupancyGrid(cells, CELL_M, np.zeros(3))
    part = OccupancyGrid(cells[:, 40:560], CELL_M, np.zeros(3))
    found = register_layers(symmetric, redrawn(part, FRAME))
    assert not found.accepted
    assert found.ambiguous, found.reason
    assert "ambiguous" in found.reason
    turns = [abs(np.degrees(se2.wrap_angle(pose_of(found)[2] - each.T_a_b[2]))) for each in found.alternatives]
    assert any(abs(turn - 180.0) < 2.0 for turn in turns)
    assert found.probability is not None
    assert found.probability + sum(each.probability for each in found.alternatives) <= 1.0 + 1e-9


def test_too_little_common_wall_is_refused_with_that_reason(view):
    a = view(0.0, 12.0, np.zeros(3), 1)
    cells = np.full((60, 60), -4.0, np.float32)
    cells[30, 10:40] = 4.0
    found = register_layers(a, OccupancyGrid(cells, CELL_M, np.zeros(3)))
    assert not found.accepted
    assert "m of wall are seen in both maps, 3 m are needed" in found.reason


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (np.zeros((40, 40), np.float32), "no cell that is free"),
        (np.full((40, 40), 4.0, np.float32), "no cell that is free"),
        (np.full((40, 40), -4.0, np.float32), "no wall"),
        (np.full((1, 1), -4.0, np.float32), "no wall"),
        (np.full((1, 1), 4.0, np.float32), "no cell that is free"),
    ],
)
def test_maps_that_cannot_be_aligned_are_refused_in_one_line(view, cells, words):
    poor, rich = OccupancyGrid(cells, CELL_M, np.zeros(3)), view(0.0, 12.0, np.zeros(3), 1)
    for pair in ((rich, poor), (poor, rich), (poor, poor)):
        found = register_layers(*pair)
        assert not found.accepted
        assert found.T_a_b is None
        assert words in found.reason
        assert "\n" not in found.reason


def test_resolutions_far_apart_and_turned_origins_are_handled(view):
    a, coarse = view(0.0, 20.0, np.zeros(3), 1), view(0.0, 30.0, FRAME, 2, 1.0)
    assert register_layers(a, coarse).T_a_b is not None
    turned = OccupancyGrid(a.log_odds, a.resolution_m, se2.compose(np.array([-4.0, 9.0, -2.5]), a.origin))
    b = view(8.0, 30.0, FRAME, 2)
    plain, moved = register_layers(a, b), register_layers(turned, b)
    middle = se2.transform_points(FRAME, np.array([14.0, 9.0]))
    there = se2.transform_points(se2.compose(np.array([-4.0, 9.0, -2.5]), pose_of(plain)), middle)
    assert np.hypot(*(se2.transform_points(pose_of(moved), middle) - there)) < 1e-6


def test_a_stricter_rule_refuses_more(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(8.0, 30.0, FRAME, 2)
    assert not register_layers(a, b, LayeredSettings(least_wall_m=500.0)).accepted
