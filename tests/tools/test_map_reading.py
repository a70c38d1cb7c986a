"""Reading a map tells what is odd about it."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.map_reading import read_saved


@pytest.mark.parametrize(("resolution_m", "told"), [(0.05, ""), (50.0, "is it right?")])
def test_what_is_odd_about_a_map_goes_to_the_log(resolution_m, told, tmp_path, caplog):
    grid = OccupancyGrid(np.full((3, 4), -1.0, np.float32), resolution_m, np.zeros(3))
    write_map(tmp_path / "map", grid)
    read = read_saved(tmp_path / "map.npz")
    np.testing.assert_array_equal(read.log_odds, grid.log_odds)
    assert told in caplog.text
    assert bool(caplog.text) == bool(told)
