"""What a picture of a plan shows, and where."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from planning.ends import PlanError
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.plan_picture import draw_plan, plan_summary

QCAR = Vehicle()


def room(rows: int = 120, cols: int = 200, origin: tuple[float, float, float] = (-1.0, -1.0, 0.0)) -> OccupancyGrid:
    cells = np.full((rows, cols), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    return OccupancyGrid(cells, 0.05, np.array(origin))


def there_and_back() -> np.ndarray:
    """4 m ahead, and 2 m back along another line."""
    ahead = np.column_stack([np.linspace(0.0, 4.0, 401), np.zeros((401, 2))])
    back = np.column_stack([np.linspace(4.0, 2.0, 201), np.linspace(0.0, 1.0, 201), np.full(201, -0.4636)])
    return np.vstack([ahead, back[1:]])


def pixels_like(image: np.ndarray, bgr: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the pixels of this colour."""
    return np.argwhere((np.abs(image.astype(int) - bgr) < 12).all(axis=2))


def solved() -> PlanResult:
    return PlanResult(path_along(there_and_back()), None, "6 m", 0.25)


def test_the_way_is_blue_ahead_and_orange_back_with_green_start_and_red_goal():
    poses = there_and_back()
    image = draw_plan(room(), poses[0], poses[-1], solved(), QCAR)[34:-74]
    green, red = pixels_like(image, (60, 160, 40)), pixels_like(image, (60, 60, 220))
    blue, orange = pixels_like(image, (190, 110, 20)), pixels_like(image, (20, 130, 240))
    assert min(map(len, (green, red, blue, orange))) > 50
    # x to the right: the start is left of the goal; y up: the way back lies above the way ahead.
    assert green[:, 1].mean() < red[:, 1].mean()
    assert red[:, 0].mean() < green[:, 0].mean()
    assert orange[:, 0].mean() < blue[:, 0].mean()
    px_per_m = np.ptp(blue[:, 1]) / (4.0 - 0.3405)  # the car at the start hides the beginning
    # The outline of the car, to scale: from its nose to its tail, and from side to side.
    assert np.ptp(green[:, 1]) / px_per_m == pytest.approx(0.425, rel=0.1)
    assert np.ptp(green[:, 0]) / px_per_m == pytest.approx(0.192, rel=0.2)


def test_a_large_map_is_cut_to_what_matters():
    poses = there_and_back()
    small, large = (draw_plan(room(size, size), poses[0], poses[-1], solved(), QCAR) for size in (200, 3000))
    assert max(large.shape) <= 1400
    ratio = len(pixels_like(large, (60, 160, 40))) / len(pixels_like(small, (60, 160, 40)))
    assert 0.8 < ratio < 1.2


@pytest.mark.parametrize("goal", [(40.0, 0.0, 0.0), (1e300, -1e300, 3.0), (-3.0, 2.0, 1.0)])
def test_an_end_outside_the_map_and_its_advice_make_a_picture(goal):
    result = PlanResult(None, PlanError.goal_outside_map, "goal is outside the map", advice=np.array([8.0, 1.0, 0.0]))
    image = draw_plan(room(), np.zeros(3), np.array(goal), result, QCAR)
    assert len(pixels_like(image[34:-74], (170, 60, 150))) > 50
    assert max(image.shape) < 3000


def test_a_map_of_one_cell_makes_a_picture():
    grid = OccupancyGrid(np.zeros((1, 1), np.float32), 0.05, np.zeros(3))
    result = PlanResult(None, PlanError.start_occupied, "unknown")
    assert draw_plan(grid, np.zeros(3), np.full(3, 1e9), result, QCAR).ndim == 3


def test_the_title_says_what_came_of_it():
    assert plan_summary(solved()) == "6.24 m, 1 gear change, nearest wall 0.250 m from the body"
    assert plan_summary(PlanResult(None, PlanError.timeout, "too long")) == "TIMEOUT: too long"
