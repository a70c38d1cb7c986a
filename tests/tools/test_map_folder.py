"""Which files and folders in a folder are maps."""

from __future__ import annotations

import os

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_lossless, write_map
from tools.errors import ToolError
from tools.map_folder import expanded, maps_in

GRID = OccupancyGrid(np.full((4, 4), -1.0, np.float32), 0.05, np.zeros(3))


def names(folder):
    return [str(path.relative_to(folder)) for path in maps_in(folder)]


def test_each_map_counts_once_and_other_files_not_at_all(tmp_path, caplog):
    caplog.set_level("INFO")
    write_map(tmp_path / "a", GRID)  # .yaml, .pgm and .npz
    write_map(tmp_path / "b", GRID)
    (tmp_path / "b.npz").unlink()
    write_lossless(tmp_path / "c.npz", GRID)
    (tmp_path / "config.yaml").write_text("lidar: {baud: 115200}\n")
    (tmp_path / "notes.txt").write_text("image: none")
    (tmp_path / ".a.npz.123.tmp").write_bytes(b"half")
    assert names(tmp_path) == ["a.npz", "b.yaml", "c.npz"]
    assert "config.yaml: names no image" in caplog.text


def test_an_image_that_was_saved_later_beside_an_old_lossless_file_counts(tmp_path):
    write_map(tmp_path / "a", GRID)
    os.utime(tmp_path / "a.npz", (1e9, 1e9))
    assert names(tmp_path) == ["a.yaml"]


def test_a_file_that_is_not_whole_still_counts_so_that_it_is_named(tmp_path):
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "half.yaml").write_text("ima")
    (tmp_path / "half.pgm").write_bytes(b"P5")
    assert names(tmp_path) == ["empty.yaml", "half.yaml"]


def test_folders_of_runs_count_as_one_map_each_and_others_do_not(tmp_path):
    for name in ("run", "replay", "running", "plain"):
        (tmp_path / name).mkdir()
    write_map(tmp_path / "run/map", GRID)
    write_map(tmp_path / "run/depth_map", GRID)
    np.savez(tmp_path / "run/slam_state.npz", poses=np.zeros(3))
    (tmp_path / "run/report.json").write_text("{}")
    write_map(tmp_path / "replay/map", GRID)
    (tmp_path / "replay/map.npz").unlink()
    (tmp_path / "replay/trajectory.tum").write_text("")
    write_lossless(tmp_path / "running/map.npz", GRID)
    (tmp_path / "running/recording.mcap").write_bytes(b"")
    write_map(tmp_path / "plain/map", GRID)
    assert names(tmp_path) == ["replay/map.yaml", "run/map.npz", "running/map.npz"]
    assert names(tmp_path / "run") == ["map.npz"]


def test_arguments_keep_their_order_with_folders_replaced(tmp_path):
    (tmp_path / "maps").mkdir()
    for name in ("maps/b", "maps/a", "z"):
        write_map(tmp_path / name, GRID)
    files = expanded([tmp_path / "z.yaml", tmp_path / "maps"])
    assert [path.name for path in files] == ["z.yaml", "a.npz", "b.npz"]


def test_a_folder_without_maps_and_one_that_cannot_be_listed_are_one_line(tmp_path):
    with pytest.raises(ToolError, match="no map in it: expected"):
        expanded([tmp_path])
    with pytest.raises(ToolError, match="cannot be listed"):
        maps_in(tmp_path / "none")
