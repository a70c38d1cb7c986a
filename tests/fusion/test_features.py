"""Keypoints and descriptors must turn with the map."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import FusionError
from fusion.features import DESCRIPTORS, DETECTORS, KAZE_SIFT, FeatureMethod, count_keypoints, detect_features
from fusion.free_space import free_layer
from fusion.matching import match_descriptors
from fusion.resampling import known_corners, raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map

METHODS = [
    FeatureMethod(detector, descriptor)
    for detector in DETECTORS
    for descriptor in DESCRIPTORS
    if descriptor in {"sift", "orb", "brisk", detector} or (detector, descriptor) == ("kaze", "akaze")
]


def share_of_true_matches(
    grid: OccupancyGrid, turn_rad: float, method: FeatureMethod = KAZE_SIFT, least: int = 50
) -> float:
    """Of the matches of a map with itself, turned, that pass the ratio test: how many lie within 3 px of the truth."""
    T = np.array([0.7, -1.3, turn_rad])
    raster = raster_around(se2.transform_points(T, known_corners(grid)), grid.resolution_m)
    turned = OccupancyGrid(resample(grid, T, raster), grid.resolution_m, raster.origin)
    features = [detect_features(free_layer(each, 0.5), method) for each in (grid, turned)]
    points = [
        se2.transform_points(each.origin, found.points * each.resolution_m)
        for each, found in zip((grid, turned), features, strict=True)
    ]
    in_a, in_b = match_descriptors(features[0].descriptors, features[1].descriptors, 0.6)
    assert len(in_a) > least
    apart = np.hypot(*(se2.transform_points(T, points[0][in_a]) - points[1][in_b]).T)
    return float(np.mean(apart < 3.0 * grid.resolution_m))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0, -37.0, 61.3, 142.8])
def test_a_turned_map_matches_itself(building, turn_deg):
    assert share_of_true_matches(building, np.radians(turn_deg)) > 0.8


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_combination_turns_with_the_map(building, method):
    """By a right angle, which leaves the corners as they are: steps of a slanted wall are corners to some."""
    least = 2 if method.detector == "fast" else 10  # FAST sees little in a drawn floor
    assert share_of_true_matches(building, np.radians(90.0), method, least) > 0.5


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@pytest.mark.parametrize("shape", [(1, 1), (3, 50), (60, 60)])
def test_a_small_map_is_no_error(method, shape):
    layer = (np.random.default_rng(1).random(shape) > 0.3).astype(np.uint8) * 255
    found = detect_features(layer, method)
    assert len(found.points) == len(found.descriptors)


def test_the_same_layer_has_the_same_features(building):
    layer = free_layer(building, 0.5)
    one, other = (detect_features(layer, FeatureMethod("orb")) for _ in range(2))
    assert one.points.tolist() == other.points.tolist()
    assert one.descriptors.dtype == np.uint8


@pytest.mark.parametrize(
    ("detector", "name"),
    [("kaze", "kaze+sift"), ("orb", "orb+orb"), ("brisk", "brisk+brisk"), ("harris", "harris+sift")],
)
def test_the_descriptor_is_the_one_of_table_4_2_and_sift_else(detector, name):
    assert FeatureMethod(detector).name == name


@pytest.mark.parametrize(
    ("detector", "descriptor", "says"),
    [
        ("surf", "", "detector surf: it is not in OpenCV's wheels"),
        ("kaze", "surf", "descriptor surf: it is not in OpenCV's wheels"),
        ("klt", "", "detector 'klt': unknown: take one of kaze"),
        ("kaze", "fast", "descriptor 'fast': unknown"),
        ("orb", "akaze", "descriptor akaze: describes keypoints of kaze and akaze only"),
        ("akaze", "kaze", "descriptor kaze: describes keypoints of kaze only"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(detector, descriptor, says):
    with pytest.raises(FusionError, match=says) as refused:
        FeatureMethod(detector, descriptor)
    assert "\n" not in str(refused.value)


@pytest.mark.real_data
@pytest.mark.parametrize("turn_deg", [90.0, 23.0, -118.0])
def test_a_turned_real_map_matches_itself(data_dir, turn_deg):
    grid = read_map(data_dir / "maps_freiburg079_incremental/map10.yaml")
    assert share_of_true_matches(grid, np.radians(turn_deg)) > 0.8


@pytest.mark.parametrize("value", [0, 255])
def test_an_even_layer_has_no_features_or_few_at_its_rim(value):
    assert len(detect_features(np.full((40, 40), value, np.uint8)).points) < 20


@pytest.mark.parametrize("detector", ["brisk", "harris", "shi-tomasi", "kaze", "orb", "sift"])
def test_all_keypoints_are_counted_however_many(detector):
    layer = (np.random.default_rng(1).random((200, 200)) > 0.5).astype(np.uint8) * 255
    most = count_keypoints(layer, detector)
    found = len(detect_features(layer, FeatureMethod(detector), strongest=None).points)
    assert most >= found
    assert len(detect_features(layer, FeatureMethod(detector), strongest=50).points) <= 50 < found
    assert count_keypoints(np.zeros_like(layer), detector) == 0
