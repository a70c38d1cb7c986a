from __future__ import annotations

import numpy as np

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.localisation import LOCALISED_NAME, Localisation


def test_a_car_that_was_not_found_is_told_at_the_end(tmp_path, caplog):
    cells = np.full((60, 60), -5.0, np.float32)
    cells[:, [0, -1]] = cells[[0, -1], :] = 5.0
    write_map(tmp_path / "map", OccupancyGrid(cells, 0.05, np.zeros(3)))
    told = Localisation(tmp_path / "map.yaml", np.zeros(2)).save(tmp_path)
    assert told["found"] is False
    assert "NOT found" in caplog.text
    assert str(told["reason"]) in caplog.text
    assert not (tmp_path / LOCALISED_NAME).exists()
