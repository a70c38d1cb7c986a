"""Keypoints and descriptors must turn with the map."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.features import detect_features
from fusion.free_space import free_layer
from fusion.matching import match_descriptors
from fusion.resampling import known_corners, raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map


def share_of_true_matches(grid: OccupancyGrid, turn_rad: float) -> float:
    """Of the matches of a map with itself, turned, that pass the ratio test: how many lie within 3 px of the truth."""
    T = np.array([0.7, -1.3, turn_rad])
    raster = raster_around(se2.transform_points(T, known_corners(grid)), grid.resolution_m)
    turned = OccupancyGrid(resample(grid, T, raster), grid.resolution_m, raster.origin)
    features = [detect_features(free_layer(each, 0.5)) for each in (grid, turned)]
    points = [
        se2.transform_points(each.origin, found.points * each.resolution_m)
        for each, found in zip((grid, turned), features, strict=True)
    ]
    in_a, in_b = match_descriptors(features[0].descriptors, features[1].descriptors, 0.6)
    assert len(in_a) > 50
    apart = np.hypot(*(se2.transform_points(T, points[0][in_a]) - points[1][in_b]).T)
    return float(np.mean(apart < 3.0 * grid.resolution_m))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0, -37.0, 61.3, 142.8])
def test_a_turned_map_matches_itself(building, turn_deg):
    assert share_of_true_matches(building, np.radians(turn_deg)) > 0.8


@pytest.mark.real_data
@pytest.mark.parametrize("turn_deg", [90.0, 23.0, -118.0])
def test_a_turned_real_map_matches_itself(data_dir, turn_deg):
    grid = read_map(data_dir / "maps_freiburg079_incremental/map10.yaml")
    assert share_of_true_matches(grid, np.radians(turn_deg)) > 0.8


@pytest.mark.parametrize("value", [0, 255])
def test_an_even_layer_has_no_features_or_few_at_its_rim(value):
    assert len(detect_features(np.full((40, 40), value, np.uint8)).points) < 20
