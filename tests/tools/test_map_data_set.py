"""The list of a map data set: everything comes back, a damaged list is one clear line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.errors import ToolError
from tools.map_data_set import LIST_NAME, DataSetMap, FloorPlan, MapDataSet, data_hash, read_data_set, write_data_set


@pytest.fixture
def data(tmp_path):
    (tmp_path / "set/maps").mkdir(parents=True)
    folder = tmp_path / "set"
    maps = []
    for name, cells, pose in (("a", 1.0, np.array([1.0, -2.0, 0.5])), ("b", -2.0, None)):
        grid = OccupancyGrid(np.full((3, 4), cells, np.float32), 0.1, np.zeros(3))
        files = write_map(folder / "maps" / name, grid)
        trajectory = folder / "maps/a.tum" if name == "a" else None
        maps.append(DataSetMap(name, files.lossless, 0.1, 2.5, 4, "car", 7, pose, trajectory))
    plan = FloorPlan(folder / "plan.png", 0.02, np.zeros(3))
    made = MapDataSet(folder, "hall", "Real data: a hall.", False, tuple(maps), "parts", plan, "data-set x")
    write_data_set(made)
    return made


def test_a_set_comes_back_as_it_was_written_also_from_another_place(data, tmp_path):
    moved = data.folder.rename(tmp_path / "moved")
    read = read_data_set(moved)
    assert (read.name, read.source, read.simulated, read.kind, read.command) == (
        "hall", "Real data: a hall.", False, "parts", "data-set x",
    )  # fmt: skip
    first, second = read.maps
    assert first.pose.tolist() == [1.0, -2.0, 0.5]
    assert second.pose is None
    assert (first.rate_hz, first.scan_every, first.robot, first.step) == (2.5, 4, "car", 7)
    assert first.path == moved / "maps/a.npz"
    assert (first.trajectory, second.trajectory) == (moved / "maps/a.tum", None)
    assert (read.floor_plan.image, read.floor_plan.resolution_m) == (moved / "plan.png", 0.02)
    assert first.cells_per_meter == pytest.approx(10.0)
    assert read.label == "hall, real data"


def test_a_plain_folder_is_read_by_the_names_of_its_maps(data):
    read = read_data_set(data.folder / "maps")
    assert [each.name for each in read.maps] == ["a", "b"]
    assert [each.path.suffix for each in read.maps] == [".npz", ".npz"]
    assert (read.kind, read.maps[0].pose, read.maps[0].scan_every) == ("", None, None)
    assert read.label == "maps, data of unknown origin"


def test_the_hash_tells_other_maps_and_other_truth(data):
    before = data_hash(data)
    assert data_hash(read_data_set(data.folder)) == before
    content = json.loads((data.folder / LIST_NAME).read_text())
    content["maps"][0]["pose"][0] += 1e-3
    (data.folder / LIST_NAME).write_text(json.dumps(content))
    assert data_hash(read_data_set(data.folder)) != before


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda content: content.update(format="other"), "not a map data set"),
        (lambda content: content.pop("source"), "source"),
        (lambda content: content.update(simulated="no"), "simulated"),
        (lambda content: content["maps"][0].update(pose=[1, 2]), "pose"),
        (lambda content: content["maps"][0].update(resolution_m=-1), "resolution_m"),
        (lambda content: content["maps"][1].update(map="maps/gone.npz"), "gone.npz"),
        (lambda content: content.update(maps=[]), "no maps"),
    ],
)
def test_a_damaged_list_is_told_in_one_line(data, change, says):
    content = json.loads((data.folder / LIST_NAME).read_text())
    change(content)
    (data.folder / LIST_NAME).write_text(json.dumps(content))
    with pytest.raises(ToolError, match=says) as error:
        read_data_set(data.folder)
    assert "\n" not in str(error.value)


def test_what_is_no_set_is_told(tmp_path):
    for folder, says in ((tmp_path / "none", "no such folder"), (tmp_path, "nor a map")):
        with pytest.raises(ToolError, match=says):
            read_data_set(folder)
    (tmp_path / LIST_NAME).write_text('{"format": ')
    with pytest.raises(ToolError, match="not JSON"):
        read_data_set(tmp_path)
    (tmp_path / LIST_NAME).unlink()
    (tmp_path / "half.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(ToolError, match=r"half\.npz"):
        read_data_set(tmp_path)
