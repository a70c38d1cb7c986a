from __future__ import annotations

import numpy as np
import pytest

from fusion.settling import UncertaintyModel, settle
from fusion.survey import SurveyedMap, survey
from mapping import se2
from mapping.grid import OccupancyGrid

FRAME = np.array([3.0, -7.0, 2.1])


@pytest.fixture(scope="module")
def pair(view) -> tuple[SurveyedMap, SurveyedMap, np.ndarray]:
    """Two views of the building, and the true pose of the second's grid in the first's."""
    a, b = survey(view(0.0, 20.0, np.zeros(3), 1)), survey(view(6.0, 30.0, FRAME, 2))
    T_a_b = se2.compose(se2.compose(se2.inverse(a.walls.T_map_grid), se2.inverse(FRAME)), b.walls.T_map_grid)
    return a, b, T_a_b


@pytest.mark.parametrize("off", [[0.0, 0.0, 0.0], [0.1, -0.05, 0.004], [-0.12, 0.1, -0.006]])
def test_the_pose_is_found_below_a_cell_and_its_covariance_is_honest(pair, off):
    a, b, truth = pair
    middle = np.array([*b.probe.points.mean(axis=0), 0.0])
    start = se2.compose(se2.compose(truth, se2.compose(middle, np.array(off))), se2.inverse(middle))
    settled = settle(a, b, start, UncertaintyModel())
    error = settled.pose - truth
    error[2] = se2.wrap_angle(error[2])
    at_middle = se2.transform_points(settled.pose, middle[:2]) - se2.transform_points(truth, middle[:2])
    assert np.hypot(*at_middle) < 0.02
    assert abs(np.degrees(error[2])) < 0.05
    assert error @ np.linalg.solve(settled.covariance, error) < 11.3  # 99 % for three degrees of freedom
    assert (np.linalg.eigvalsh(settled.covariance) > 0.0).all()


def test_exchanged_maps_settle_at_the_inverse(pair):
    a, b, truth = pair
    there = settle(a, b, truth, UncertaintyModel()).pose
    back = settle(b, a, se2.inverse(truth), UncertaintyModel()).pose
    loop = se2.compose(there, back)
    assert np.hypot(loop[0], loop[1]) < 0.01
    assert abs(loop[2]) < 5e-4


def test_bent_maps_are_less_sure(pair, view):
    a, b, truth = pair
    straight = settle(a, b, truth, UncertaintyModel()).covariance
    grid = view(6.0, 30.0, FRAME, 2)
    cols = grid.log_odds.shape[1]
    bow = np.rint(4.0 * np.sin(np.arange(cols) / cols * 3.0 * np.pi)).astype(int)  # up to 0.2 m
    cells = np.column_stack([np.roll(grid.log_odds[:, col], bow[col]) for col in range(cols)])
    bent = settle(a, survey(OccupancyGrid(cells, grid.resolution_m, grid.origin)), truth, UncertaintyModel()).covariance
    assert np.linalg.det(bent) > 20.0 * np.linalg.det(straight)


def test_a_corridor_is_unsure_along_its_length():
    cells = np.zeros((60, 400), np.float32)
    cells[20:46] = -3.0
    cells[[20, 46]] = 3.0
    corridor = survey(OccupancyGrid(cells, 0.05, np.zeros(3)))
    covariance = settle(corridor, corridor, np.zeros(3), UncertaintyModel()).covariance
    middle = corridor.probe.points.mean(axis=0)
    across = covariance[1, 1] + 2.0 * middle[0] * covariance[1, 2] + middle[0] ** 2 * covariance[2, 2]
    assert covariance[0, 0] > 100.0 * across
