from __future__ import annotations

import numpy as np
import pytest

from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.simulator import drive_along
from tools.world import BUILT_IN, OFFICE_TOUR, TOURS, World, load_world, office


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_world_is_its_own_mirror_image_in_any_axis(name):
    walls = load_world(name).occupied
    for image in (walls[::-1], walls[:, ::-1], walls[::-1, ::-1]):
        assert (image != walls).mean() > 0.05


@pytest.mark.parametrize("name", TOURS)
def test_a_world_is_closed_and_its_drive_keeps_off_the_walls(name):
    """Seen from everywhere on the drive; the car is 0.2 m wide."""
    world, waypoints = TOURS[name]
    angles = np.linspace(0, 2 * np.pi, 400)
    walls = load_world(world)
    for pose in drive_along(waypoints).poses[::10]:
        ranges = walls.ranges(np.tile(pose, (len(angles), 1)), angles, 100.0)
        assert (ranges > 0.11).all()


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


def test_a_car_stands_neither_outside_of_the_world_nor_in_a_wall():
    turned = World(np.array([[False, False, True]]), 1.0, np.array([10.0, 0.0, np.pi / 2]))
    assert turned.objection(9.5, 0.5) is None
    assert turned.objection(9.5, 2.5) == "in a wall"
    outside = turned.objection(0.5, 0.5)
    assert outside is not None
    assert "x 9.00 to 10.00 m, y 0.00 to 3.00 m" in outside
    assert all(office().objection(*place) is None for place in OFFICE_TOUR)
