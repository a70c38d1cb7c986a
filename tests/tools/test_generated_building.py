from __future__ import annotations

import cv2
import numpy as np
import pytest

from mapping import se2
from tools.generated_building import two_drives
from tools.simulator import MAX_STEERING_RAD, WHEELBASE_M
from tools.solid_world import ROOM_HEIGHT_M
from tools.world import World

SEEDS = (0, 1, 2, 5)


@pytest.fixture(scope="module")
def sites():
    return {seed: two_drives(seed) for seed in SEEDS}


def cells_of(world, points):
    cols, rows = np.floor((points - world.origin[:2]) / world.resolution_m).astype(int).T
    return rows, cols


def test_a_seed_always_gives_the_same_building_and_another_seed_another_one(sites):
    again = two_drives(1)
    assert np.array_equal(again.building.world.heights_m, sites[1].building.world.heights_m)
    assert np.array_equal(again.drives[1].poses, sites[1].drives[1].poses)
    plans = [site.building.world.cut(2.4) for site in sites.values()]
    for number, one in enumerate(plans):
        for other in plans[number + 1 :]:
            rows, cols = (min(a, b) for a, b in zip(one.occupied.shape, other.occupied.shape, strict=True))
            inner = np.s_[60 : rows - 60, 60 : cols - 60]  # inside the outer walls
            both = one.occupied[inner] & other.occupied[inner]
            assert both.sum() < 0.5 * one.occupied[inner].sum()


@pytest.mark.parametrize("seed", SEEDS)
def test_cars_drive_as_cars_do_and_touch_nothing(seed, sites):
    site = sites[seed]
    world = site.building.world
    standing = (world.heights_m > 0.0).astype(np.uint8)
    for drive in site.drives:
        steps = se2.log(se2.between(drive.poses[:-1], drive.poses[1:]))
        moving = steps[:, 0] > 0.01
        assert (np.abs(steps[moving, 2]) <= np.tan(MAX_STEERING_RAD) / WHEELBASE_M * steps[moving, 0] * 1.01).all()
        nose = drive.poses[:, :2] + 0.3 * np.column_stack([np.cos(drive.poses[:, 2]), np.sin(drive.poses[:, 2])])
        for points in (drive.poses[:, :2], nose):
            swept = np.zeros_like(standing)
            swept[cells_of(world, points)] = 1
            near = cv2.dilate(swept, np.ones((9, 9), np.uint8))  # a car is 0.2 m wide
            assert not (near & standing).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_cars_start_in_rooms_of_their_own_and_share_two(seed, sites):
    site = sites[seed]
    a, b = site.visits
    assert (len(a), len(b), len(set(a) & set(b))) == (4, 3, 2)
    assert a[0] not in b
    assert b[0] not in a
    for visits, drive in zip(site.visits, site.drives, strict=True):
        for visit in visits:
            x0, y0, x1, y1 = site.building.rooms[visit].inside
            x, y = drive.poses[:, :2].T
            inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
            middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)])
            around = np.unwrap(np.arctan2(y[inside] - middle[1], x[inside] - middle[0]))
            assert np.ptp(around) > np.radians(180.0)  # round the room, not only into it
        x0, y0, x1, y1 = site.building.rooms[visits[0]].inside
        assert x0 < drive.poses[0, 0] < x1
        assert y0 < drive.poses[0, 1] < y1


@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_are_closed_but_for_their_doors(seed, sites):
    building = sites[seed].building
    walls = building.world.cut(ROOM_HEIGHT_M - 0.1).occupied
    free = (~walls).astype(np.uint8)
    for room in building.rooms:
        x, y = room.door
        rows, cols = cells_of(building.world, np.array([(x, y), room.corridor]))
        assert free[rows, cols].all()
        closed = World(walls.copy(), building.world.resolution_m, building.world.origin)
        (row,), (left, right) = rows[:1], (cols[0] - 70, cols[0] + 70)
        closed.occupied[row - 4 : row + 5, left:right] = True
        _, labels = cv2.connectedComponents((~closed.occupied).astype(np.uint8), connectivity=4)
        x0, y0, x1, y1 = room.inside
        inside_row, inside_col = cells_of(building.world, np.array([(x0 + x1, y0 + y1)]) / 2)
        assert (
            labels[inside_row[0], inside_col[0]] != labels[rows[1], cols[1]] or not free[inside_row[0], inside_col[0]]
        )


def test_laser_and_camera_do_not_see_the_same_in_all_buildings(sites):
    worlds = [site.building.world for site in sites.values()]
    assert any((world.bottoms_m > 0.19).any() for world in worlds)  # table tops
    assert any(((world.heights_m > 0.1) & (world.heights_m < 0.19)).any() for world in worlds)  # low things
    assert all(((world.heights_m >= 0.4) & (world.heights_m < 2.1)).any() for world in worlds)
