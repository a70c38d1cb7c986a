"""Files, and the maps that they are."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.map_files import read_maps


def test_files_of_one_map_are_one_whatever_their_form_and_frame(tmp_path, rooms_part):
    frame = np.array([2.0, -1.0, 0.7])
    write_map(tmp_path / "here", rooms_part(1))
    write_map(tmp_path / "there", rooms_part(1, frame=frame))
    write_map(tmp_path / "other", rooms_part(2))
    files = [tmp_path / name for name in ("other.yaml", "there.npz", "here.yaml", "here.npz")]
    loaded = read_maps(files)
    assert len(loaded.maps) == 2
    assert len({loaded.name_of[number] for number in (1, 2, 3)}) == 1
    assert [loaded.first_of(loaded.name_of[number]) for number in range(4)] == [0, 1, 1, 1]
    # Wherever the one that stands for all lies, all lie on each other.
    there, here = (loaded.pose_in_group(number, np.array([5.0, 5.0, -2.0])) for number in (1, 3))
    np.testing.assert_allclose(se2.between(there, here), frame, atol=1e-9)


def test_which_file_stands_for_a_map_does_not_depend_on_the_order(tmp_path, rooms_part):
    write_map(tmp_path / "here", rooms_part(1))
    write_map(tmp_path / "there", rooms_part(1, frame=np.array([2.0, -1.0, 0.7])))
    files = [tmp_path / "here.npz", tmp_path / "there.npz"]
    (one,), (other,) = (read_maps(each).maps.values() for each in (files, files[::-1]))
    np.testing.assert_array_equal(one.origin, other.origin)


def test_maps_of_a_few_cells_are_alike_by_chance(tmp_path):
    for name in ("a", "b"):
        write_map(tmp_path / name, OccupancyGrid(np.full((5, 5), -3.0, np.float32), 0.05, np.zeros(3)))
    assert len(read_maps([tmp_path / "a.yaml", tmp_path / "b.yaml"]).maps) == 2


def test_what_cannot_be_used_is_told_and_left_out(tmp_path, rooms_part, caplog):
    write_map(tmp_path / "good", rooms_part(1))
    write_map(tmp_path / "blank", OccupancyGrid(np.zeros((9, 9), np.float32), 0.05, np.zeros(3)))
    (tmp_path / "bad.yaml").write_bytes(b"\x00\xff")
    files = [tmp_path / name for name in ("bad.yaml", "good.yaml", "blank.yaml", "none.npz")]
    loaded = read_maps(files)
    assert list(loaded.grids) == [1]
    assert sorted(loaded.skipped) == [0, 2, 3]
    for number in loaded.skipped:
        assert str(files[number]) in loaded.skipped[number]
        assert f"{loaded.skipped[number]}: skipped" in caplog.text


def test_nothing_that_can_be_read_is_an_error(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.yaml"):
        read_maps([tmp_path / "none.yaml", tmp_path / "neither.npz"])
