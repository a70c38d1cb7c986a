"""A map image matched with itself, turned and rescaled: what is found is what was done to it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from fusion.features import FeatureMethod, Features
from fusion.occupancy_image import rescale_bicubic, turn_nearest
from mapping.grid import OccupancyGrid
from tools.matched_images import METHODS, agreement, image_name, image_of, putative_matches, timed_features

KAZE, ORB, SIFT = METHODS


@pytest.fixture(scope="module")
def grid():
    image = np.full((160, 200), 255, np.uint8)
    for x, y, width, height in np.random.default_rng(5).integers([5, 5, 4, 4], [190, 150, 24, 24], (40, 4)).tolist():
        cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)
    return OccupancyGrid(np.where(image > 0, -5.0, 5.0).astype(np.float32), 0.1, np.zeros(3))


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@pytest.mark.parametrize("similarity", [False, True])
def test_an_image_matches_itself_without_outliers(grid, method, similarity):
    found = timed_features(image_of(grid, 0.5), method)
    match = agreement(putative_matches(found.features, found.features), 0, similarity=similarity)
    assert match.inliers == match.matches > 20
    assert match.precision == 1.0
    assert match.turn_rad == pytest.approx(0.0, abs=1e-6)
    assert match.scale == pytest.approx(1.0, abs=1e-6)
    assert found.seconds > 0.0
    assert match.seconds > 0.0


@pytest.mark.parametrize("turn_deg", [90.0, 30.0])
def test_a_turn_of_the_moving_image_comes_back_reversed(grid, turn_deg):
    image = image_of(grid, 0.5)
    turned = turn_nearest(image, math.radians(turn_deg))
    fixed, moving = (timed_features(each, KAZE).features for each in (image, turned))
    match = agreement(putative_matches(fixed, moving), 1, similarity=False)
    assert match.inliers >= 10
    assert match.turn_rad is not None
    assert math.degrees(match.turn_rad) == pytest.approx(-turn_deg, abs=0.5)


def test_the_scale_is_the_ratio_of_the_cells(grid):
    image = image_of(grid, None)
    fixed, moving = (timed_features(each, KAZE).features for each in (image, rescale_bicubic(image, 0.1, 0.08)))
    match = agreement(putative_matches(fixed, moving), 1, similarity=True)
    assert match.scale == pytest.approx(0.8, rel=0.01)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_limit_of_distance_only_drops_matches(grid, method):
    fixed, moving = (
        timed_features(image, method).features
        for image in (image_of(grid, None), turn_nearest(image_of(grid, None), 0.4))
    )
    putative = putative_matches(fixed, moving)
    all_of_them, near = (agreement(putative, 0, similarity=False, only_near=limit) for limit in (False, True))
    assert near.matches == np.count_nonzero(putative.near) < all_of_them.matches


def test_the_limit_of_distance_is_a_tenth_of_the_bits_or_a_hundredth_of_the_square():
    points = np.zeros((3, 2))
    bits = np.zeros((3, 32), np.uint8)
    bits[1, :], bits[2, :] = 0xF0, 0xFF  # 128 and 256 of 256 bits away from the first
    others = bits.copy()
    others[0, :4] = [0xFF, 0xFF, 0xFF, 0x01]  # 25 bits
    others[1, :4] = [0x0F, 0x0F, 0x0F, 0xFC]  # 26 bits
    putative = putative_matches(Features(points, bits), Features(points, others))
    assert putative.near.tolist() == [True, False, True]
    sides = np.eye(3, dtype=np.float32)
    turned = sides + np.float32(1.0) * np.array([[0.0, 0.19, 0.0], [0.0, 0.0, 0.21], [0.0, 0.0, 0.0]], np.float32)
    assert putative_matches(Features(points, sides), Features(points, turned)).near.tolist() == [True, False, True]


def test_without_anything_there_is_no_motion(grid):
    nothing = timed_features(np.zeros((30, 30), np.uint8), ORB).features
    something = timed_features(image_of(grid, None), ORB).features
    for fixed, moving in ((nothing, something), (something, nothing)):
        match = agreement(putative_matches(fixed, moving), 0, similarity=False, only_near=True)
        assert (match.matches, match.inliers, match.turn_rad, match.precision) == (0, 0, None, None)


def test_the_methods_are_those_of_table_4_2():
    assert [method.name for method in METHODS] == ["kaze+kaze", "orb+orb", "sift+sift"]
    assert FeatureMethod("sift") == SIFT


def test_images_are_named_by_what_they_show(grid):
    names = [image_name(alpha) for alpha in (None, 0.0, 0.5, 0.99)]
    assert names == ["O", "O as probabilities", "O^free, alpha 0.5", "O^free, alpha 0.99"]
    assert np.unique(image_of(grid, None)).tolist() == [128, 255]
    assert np.unique(image_of(grid, 0.5)).tolist() == [0, 255]
    faint = OccupancyGrid(grid.log_odds / 5.0, 0.1, np.zeros(3))
    assert np.unique(image_of(faint, 0.0)).tolist() == [69, 186]  # 255 (1 - p) of walls and of free cells
