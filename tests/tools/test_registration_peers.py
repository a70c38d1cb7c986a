"""The peers of the registration: each finds a known transform again, says so, and takes what no map is."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.evaluation import alignment_error
from fusion.resampling import known_corners, raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.registration_peers import register_as_m_explore, register_by_spectra
from tools.world import office

WORLD = office()
OFFICE = OccupancyGrid(np.where(WORLD.occupied, 4.0, -3.0).astype(np.float32), WORLD.resolution_m, WORLD.origin)
NOTHING = OccupancyGrid(np.zeros((30, 20), np.float32), 0.05, np.zeros(3))
T_MAP_OFFICE = np.array([7.0, -12.0, 2.2])  # more than a quarter turn: the spectra alone leave a half turn open

PEERS = {
    "orb": lambda a, b: register_as_m_explore(a, b, "orb", 0),
    "akaze": lambda a, b: register_as_m_explore(a, b, "akaze", 0),
    "spectra": register_by_spectra,
}


def redrawn(T_map_office, resolution_m, low_m=-1.0, high_m=17.0, seed=0):
    """The office from x = low_m to high_m, in another frame, with 1 % of the cells lost and evidence of its own."""
    raster = raster_around(se2.transform_points(T_map_office, known_corners(OFFICE)), resolution_m)
    cells = resample(OFFICE, T_map_office, raster)
    grid = OccupancyGrid(cells, resolution_m, raster.origin)
    rows, cols = np.indices(cells.shape)
    x = se2.transform_points(se2.inverse(T_map_office), grid.cell_centers(rows.ravel(), cols.ravel()))[:, 0]
    random = np.random.default_rng(seed)
    kept = ((x >= low_m) & (x <= high_m)).reshape(cells.shape) & (random.random(cells.shape) > 0.01)
    noisy = np.where(kept, cells * random.uniform(0.8, 1.0, cells.shape), 0.0)
    return OccupancyGrid(noisy.astype(np.float32), resolution_m, raster.origin)


def error_of(found, a, b, T_a_b):
    assert found.T_a_b is not None
    return alignment_error(a, b, found.T_a_b, T_a_b)


@pytest.fixture(scope="module")
def fixed():
    return redrawn(se2.IDENTITY, 0.05, high_m=13.0)


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("turn", [0.0, 2.2, -1.0])
def test_a_known_transform_is_recovered(name, turn, fixed):
    T_map_office = np.array([7.0, -12.0, turn])
    moving = redrawn(T_map_office, 0.05, low_m=2.0, seed=1)
    found = PEERS[name](fixed, moving)
    error = error_of(found, fixed, moving, se2.inverse(T_map_office))
    assert error.rms_m < 0.15
    assert error.rotation_deg < 1.0


@pytest.mark.parametrize("name", ["akaze", "spectra"])
@pytest.mark.parametrize("swapped", [False, True])
def test_maps_of_two_resolutions_need_no_scale(name, swapped, fixed):
    coarse = redrawn(T_MAP_OFFICE, 0.10, seed=1)
    T_a_b = se2.inverse(T_MAP_OFFICE)
    a, b, truth = (coarse, fixed, T_MAP_OFFICE) if swapped else (fixed, coarse, T_a_b)
    error = error_of(PEERS[name](a, b), a, b, truth)
    assert error.rms_m < 0.25
    assert error.rotation_deg < 1.5


def test_a_map_larger_than_the_picture_is_pooled():
    """0.02 m over 17 m are more cells than the picture has."""
    a, b = redrawn(se2.IDENTITY, 0.02), redrawn(T_MAP_OFFICE, 0.02, seed=1)
    error = error_of(register_by_spectra(a, b), a, b, se2.inverse(T_MAP_OFFICE))
    assert error.rms_m < 0.1


def test_m_explore_merges_over_its_confidence_and_never_below(fixed):
    same = register_as_m_explore(fixed, redrawn(T_MAP_OFFICE, 0.05, seed=1), "akaze", 0)
    random = np.random.default_rng(3)
    clutter = OccupancyGrid(random.choice([-3.0, 4.0], (200, 200)).astype(np.float32), 0.05, np.zeros(3))
    other = register_as_m_explore(fixed, clutter, "akaze", 0)
    assert same.merges is True
    assert other.merges is False
    assert same.confidence is not None
    assert other.confidence is not None
    assert other.confidence <= 1.0 < same.confidence


@pytest.mark.parametrize("detector", ["orb", "akaze"])
def test_the_same_seed_gives_the_same_pose(detector, fixed):
    moving = redrawn(T_MAP_OFFICE, 0.05, seed=1)
    first, second = (register_as_m_explore(fixed, moving, detector, 5) for _ in range(2))
    np.testing.assert_array_equal(first.T_a_b, second.T_a_b)
    assert first.confidence == second.confidence


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("cells", [NOTHING.log_odds, np.full((1, 1), -3.0, np.float32), np.full((9, 9), 4.0)])
def test_what_shows_no_place_is_never_merged(name, cells, fixed):
    for resolution_m in (0.05, 0.01):
        blank = OccupancyGrid(cells, resolution_m, np.zeros(3))
        for a, b in ((fixed, blank), (blank, fixed)):
            found = PEERS[name](a, b)
            assert not found.merges
            assert found.T_a_b is None or np.isfinite(found.T_a_b).all()
