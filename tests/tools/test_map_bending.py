"""Bent maps: the field is as smooth and strong as asked for, and the truth leads points where both fields put them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from tools.log_windows import as_camera, map_of
from tools.map_bending import BendingField, bent_map_of, bent_truth, draw_field, draw_field_pair
from tools.pair_overlap import common_wall_m, wall_line

STILL = BendingField(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 2)))
SCANS = np.arange(60)
T_B_LOG = np.array([7.0, -3.0, 2.1])


def test_a_field_moves_points_as_far_as_asked_for():
    points = np.random.default_rng(0).uniform(-500.0, 500.0, (20_000, 2))
    for rms_m in (0.05, 0.4):
        moved = draw_field(np.random.default_rng(3), rms_m).bend(points) - points
        assert np.sqrt((moved**2).sum(axis=1).mean()) == pytest.approx(rms_m, rel=0.05)


def test_a_field_is_smooth_and_another_for_another_seed():
    points = np.random.default_rng(0).uniform(-50.0, 50.0, (500, 2))
    field, other = (draw_field(np.random.default_rng(seed), 0.3) for seed in (1, 2))
    stretched = field.bend(points + np.array([0.1, 0.0])) - field.bend(points) - np.array([0.1, 0.0])
    assert np.hypot(*stretched.T).max() < 0.1 * 0.3 * 6 * 2.0 * np.pi / 12.0
    assert (draw_field(np.random.default_rng(1), 0.3).bend(points) == field.bend(points)).all()
    assert np.abs(other.bend(points) - field.bend(points)).max() > 0.1


def test_without_a_field_a_map_is_as_the_scans_make_it(corridor_drive):
    plain = map_of(corridor_drive, SCANS, 0.05, T_B_LOG)
    bent = bent_map_of(corridor_drive, SCANS, 0.05, T_B_LOG, STILL)
    there = bent.cell_coordinates(plain.cell_centers(*np.nonzero(plain.occupied)))
    cols, rows = np.floor(there + 1e-6).astype(int).T
    inside = (rows >= 0) & (rows < bent.occupied.shape[0]) & (cols >= 0) & (cols < bent.occupied.shape[1])
    assert inside.mean() > 0.99
    assert bent.occupied[rows[inside], cols[inside]].mean() > 0.98


def test_walls_are_where_the_field_moves_them(corridor_drive):
    field = draw_field(np.random.default_rng(4), 0.4)
    plain = wall_line(map_of(corridor_drive, SCANS, 0.05, se2.IDENTITY))
    bent = wall_line(bent_map_of(corridor_drive, SCANS, 0.05, se2.IDENTITY, field))
    led = replace(plain, points=field.bend(plain.points))
    assert common_wall_m(bent, led, se2.IDENTITY, 0.1) > 1.3 * common_wall_m(bent, plain, se2.IDENTITY, 0.1)


def test_a_beam_without_return_stays_one_and_makes_no_wall(corridor_drive):
    near = np.column_stack([np.full(5, 14.9), np.linspace(-0.5, 0.5, 5)])
    far = np.column_stack([np.full(5, 15.2), np.linspace(3.0, 4.0, 5)])
    drive = replace(corridor_drive, poses=np.zeros((1, 3)), points=(np.vstack([near, far]),))
    for seed in range(8):
        grid = bent_map_of(drive, np.arange(1), 0.05, se2.IDENTITY, draw_field(np.random.default_rng(seed), 0.5))
        middles = grid.cell_centers(*np.nonzero(grid.log_odds > 0.0))
        assert len(middles) >= 3
        assert (middles[:, 1] < 2.2).all()


def test_the_truth_brings_the_points_of_one_place_together(corridor_drive):
    fields = draw_field(np.random.default_rng(5), 0.2), draw_field(np.random.default_rng(6), 0.2)
    numbers = np.arange(0, 40), np.arange(20, 60)
    truth = bent_truth((corridor_drive, corridor_drive), numbers, fields, T_B_LOG)
    assert truth is not None
    apart = np.hypot(*(se2.transform_points(truth.T_a_b, truth.points_b) - truth.points_a).T)
    residual_m = float(np.sqrt((apart**2).mean()))
    assert truth.right_m == pytest.approx(0.5 + residual_m)
    assert 0.01 < residual_m < 0.6
    for off in np.vstack([np.eye(3), -np.eye(3)]) * np.array([0.1, 0.1, 0.02]):
        moved = se2.transform_points(se2.compose(truth.T_a_b, off), truth.points_b)
        assert ((moved - truth.points_a) ** 2).sum() > (apart**2).sum()


def test_without_a_field_the_truth_is_the_frame(corridor_drive):
    truth = bent_truth((corridor_drive, corridor_drive), (SCANS, SCANS), (STILL, STILL), T_B_LOG)
    assert truth is not None
    assert truth.T_a_b == pytest.approx(se2.inverse(T_B_LOG), abs=1e-9)
    assert truth.right_m == pytest.approx(0.5)


def test_two_maps_without_a_common_place_have_no_truth(corridor_drive):
    camera = as_camera(corridor_drive, np.random.default_rng(0))
    ends = np.arange(5), np.arange(100, 105)
    assert bent_truth((corridor_drive, camera), ends, (STILL, STILL), T_B_LOG) is None


def test_the_range_of_the_bend_can_be_named():
    points = np.random.default_rng(1).uniform(-200.0, 200.0, (4000, 2))
    for seed in range(5):
        for field in draw_field_pair(np.random.default_rng(seed), (0.5, 0.6)):
            moved = field.bend(points) - points
            assert 0.4 < np.sqrt((moved**2).sum(axis=1).mean()) < 0.75
