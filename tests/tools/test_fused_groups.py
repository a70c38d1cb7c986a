"""Which global map a map is in."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.map_set import MapSet
from mapping.grid import OccupancyGrid
from tools.fused_groups import FusedGroups, global_maps


def test_maps_that_nothing_connects_are_a_global_map_each_in_their_own_frames():
    grids = {
        name: OccupancyGrid(np.full((side, 20), -2.0, np.float32), 0.05, np.array([side, 0.0, 0.0]))
        for name, side in (("small", 10), ("large", 30))
    }
    maps = MapSet().added(grids)
    fused = FusedGroups(global_maps(maps, maps.structure()), {})
    assert [fused.group_of(name)[0] for name in ("large", "small")] == [0, 1]
    for name, grid in grids.items():
        _, group = fused.group_of(name)
        np.testing.assert_array_equal(group.T_global_map[name], np.zeros(3))
        np.testing.assert_array_equal(group.cells.grid().log_odds[group.cells.grid().known], grid.log_odds.ravel())
    with pytest.raises(StopIteration):
        fused.group_of("none")
