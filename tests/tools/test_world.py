from __future__ import annotations

import numpy as np
import pytest

from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.world import load_world, office


def test_office_is_not_its_own_mirror_image_in_any_axis():
    walls = office().occupied
    for image in (walls[::-1], walls[:, ::-1], walls[::-1, ::-1]):
        assert (image != walls).mean() > 0.05


def test_office_is_closed():
    world = office()
    angles = np.linspace(0, 2 * np.pi, 400)
    for start in ([3.0, 3.6], [13.0, 10.0], [8.0, 5.7]):
        poses = np.tile([*start, 0.0], (len(angles), 1))
        assert (world.ranges(poses, angles, 100.0) > 0).all()


def test_world_of_a_map_file_is_seen_as_the_map_says(tmp_path):
    log_odds = np.full((60, 100), -5.0, np.float32)
    log_odds[:, 80] = 5.0  # a wall at x = 4 m, seen from the map's corner
    write_map(tmp_path / "w", OccupancyGrid(log_odds, 0.05, np.array([10.0, -3.0, np.pi / 2])))
    world = load_world(str(tmp_path / "w.yaml"))
    standing = np.array([[8.5, -2.0, 0.0]])  # 1.0 m along the map's x, 1.5 m along its y, which points to -x
    assert world.ranges(standing, np.array([np.pi / 2]), 20.0) == pytest.approx([3.0], abs=0.06)
    assert world.ranges(standing, np.array([-np.pi / 2]), 20.0) == pytest.approx([0.0])  # leaves the map


def test_world_that_is_no_map_is_refused(tmp_path):
    with pytest.raises(MapFileError):
        load_world(str(tmp_path / "nothing.yaml"))
