"""Gears and speeds along poses."""

from __future__ import annotations

import numpy as np
import pytest

from planning.path import TOP_SPEED_MPS, path_along


def line(length_m: float, yaw: float = 0.0) -> np.ndarray:
    along = np.arange(0.0, length_m + 1e-9, 0.01)
    return np.column_stack([np.cos(yaw) * along, np.sin(yaw) * along, np.full(len(along), yaw)])


def test_a_long_straight_way_is_driven_at_top_speed_and_to_a_stop():
    path = path_along(line(4.0, 0.4))
    assert path.length_m == pytest.approx(4.0)
    assert path.speed_mps.max() == TOP_SPEED_MPS
    assert path.speed_mps[-1] == 0.0
    assert set(path.direction.tolist()) == {1}


def test_against_its_heading_the_car_drives_backwards():
    poses = line(1.0)
    poses[:, 2] = np.pi
    assert set(path_along(poses).direction.tolist()) == {-1}


def test_a_turn_is_driven_slower_than_a_straight():
    angles = np.arange(0.0, 2.0 * np.pi, 0.01 / 0.45)
    circle = np.column_stack([0.45 * np.sin(angles), 0.45 * (1.0 - np.cos(angles)), angles])
    fastest = path_along(circle).speed_mps.max()
    assert fastest == pytest.approx(np.sqrt(0.5 * 0.45), rel=0.01)


@pytest.mark.parametrize("count", [1, 2])
def test_the_shortest_paths_have_a_speed_too(count):
    path = path_along(line(1.0)[:count])
    assert len(path.direction) == len(path.speed_mps) == count
    assert path.speed_mps[-1] == 0.0
