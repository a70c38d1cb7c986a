from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from mapping.errors import MapFileError
from mapping.grid import LOG_ODDS_CLAMP, OccupancyGrid
from mapping.map_image import ImageFormat
from mapping.map_io import MapMode, read_map, read_map_with_warnings, write_lossless, write_map

CELLS = npst.arrays(
    np.float32,
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    elements=st.one_of(st.just(0.0), st.floats(-LOG_ODDS_CLAMP, LOG_ODDS_CLAMP, width=32)),
)
ORIGINS = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.2, 3.2)).map(np.array)
RESOLUTIONS = st.floats(1e-3, 10.0)


def asymmetric_grid(yaw: float = 0.0) -> OccupancyGrid:
    """Return 4 rows x 7 columns, different from every mirror image and transpose, with values that tell modes apart."""
    p = np.full((4, 7), 0.5)
    p[0] = 0.97  # a wall along the lowest y
    p[1:, 6] = 0.8
    p[1, :5] = 0.02
    p[2, 1] = 0.4
    p[3, 0] = 0.15
    log_odds = np.log(p / (1.0 - p)).astype(np.float32)
    return OccupancyGrid(log_odds, 0.0125, np.array([-1.25, 0.1 + 0.2, yaw]))


def states(grid: OccupancyGrid) -> NDArray[np.int8]:
    return np.where(grid.occupied, 1, np.where(grid.free, -1, 0)).astype(np.int8)


# Round trips


@pytest.mark.parametrize("image_format", ["pgm", "png"])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_trinary_keeps_free_occupied_and_unknown(image_format: ImageFormat, yaw: float, tmp_path: Path) -> None:
    grid = asymmetric_grid(yaw)
    files = write_map(tmp_path / "map", grid, image_format=image_format)
    again = read_map(files.yaml)
    np.testing.assert_array_equal(states(again), states(grid))
    assert again.resolution_m == 0.0125
    assert again.origin.tolist() == grid.origin.tolist()
    assert sorted(set(np.round(again.probability, 4).ravel().tolist())) == pytest.approx([0.004, 0.5, 0.996], abs=1e-6)


@pytest.mark.parametrize("image_format", ["pgm", "png"])
def test_raw_keeps_every_per_cent(image_format: ImageFormat, tmp_path: Path) -> None:
    grid = asymmetric_grid()
    again = read_map(write_map(tmp_path / "map", grid, mode=MapMode.RAW, image_format=image_format).yaml)
    np.testing.assert_array_equal(again.known, grid.known)
    np.testing.assert_allclose(again.probability, grid.probability, atol=0.00501)  # half of one per cent
    twice = read_map(write_map(tmp_path / "twice", again, mode=MapMode.RAW, image_format=image_format).yaml)
    np.testing.assert_array_equal(twice.log_odds, again.log_odds)


def test_scale_keeps_unknown_and_stretches_probabilities_as_nav2_does(tmp_path: Path) -> None:
    grid = asymmetric_grid()
    again = read_map(write_map(tmp_path / "map", grid, mode=MapMode.SCALE, image_format="png").yaml)
    np.testing.assert_array_equal(again.known, grid.known)
    np.testing.assert_array_equal(states(again), states(grid))
    # The format is not exact: 40 % comes back as (0.4 - 0.196) / (0.65 - 0.196) = 45 %.
    assert again.probability[2, 1] == pytest.approx(0.45)


def test_scale_needs_transparency(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="write png"):
        write_map(tmp_path / "map", asymmetric_grid(), mode=MapMode.SCALE)
    assert list(tmp_path.iterdir()) == []


@given(CELLS, RESOLUTIONS, ORIGINS)
def test_any_grid_keeps_its_frame_and_its_known_cells(
    cells: NDArray[np.float32], resolution_m: float, origin: NDArray[np.float64]
) -> None:
    grid = OccupancyGrid(cells, resolution_m, origin)
    with TemporaryDirectory() as folder:
        files = write_map(Path(folder) / "m", grid, mode=MapMode.RAW, provenance={"source": "a.mcap"})
        raw, lossless = read_map(files.yaml), read_map_with_warnings(files.lossless)
    for read in (raw, lossless.grid):
        assert read.resolution_m == resolution_m
        np.testing.assert_array_equal(read.origin, origin)
        np.testing.assert_array_equal(read.known, grid.known)
    np.testing.assert_array_equal(lossless.grid.log_odds, cells)
    assert lossless.provenance == {"source": "a.mcap"}
    assert (lossless.warnings == ()) == (0.005 <= resolution_m <= 1.0)


@given(CELLS)
def test_trinary_never_turns_a_state_into_another(cells: NDArray[np.float32]) -> None:
    grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    with TemporaryDirectory() as folder:
        again = read_map(write_map(Path(folder) / "m", grid).yaml)
    np.testing.assert_array_equal(states(again), states(grid))


# Orientation, by hand-made bytes


def hand_made(
    tmp_path: Path, pixels: bytes, *, origin: str = "[1.0, 2.0, 0.0]", more: str = "negate: 0"
) -> OccupancyGrid:
    """Read a PGM of 3 x 2 pixels of half a metre."""
    (tmp_path / "hand.pgm").write_bytes(b"P5\n3 2\n255\n" + pixels)
    text = f"image: hand.pgm\nresolution: 0.5\norigin: {origin}\noccupied_thresh: 0.65\nfree_thresh: 0.196\n{more}\n"
    (tmp_path / "hand.yaml").write_text(text, encoding="utf-8")
    return read_map(tmp_path / "hand.yaml")


def occupied_centres(grid: OccupancyGrid) -> list[list[float]]:
    return grid.cell_centers(*np.nonzero(grid.occupied)).tolist()


def test_first_pixel_is_the_upper_left_corner(tmp_path: Path) -> None:
    grid = hand_made(tmp_path, bytes([0, 254, 254, 254, 254, 205]))
    assert grid.log_odds.shape == (2, 3)
    assert occupied_centres(grid) == [[1.25, 2.75]]  # x 1.0..1.5, y 2.5..3.0
    assert grid.cell_centers(*np.nonzero(~grid.known)).tolist() == [[2.25, 2.25]]  # the last pixel: lower right


def test_the_yaw_of_the_origin_turns_the_map_about_its_corner(tmp_path: Path) -> None:
    grid = hand_made(tmp_path, bytes([0, 254, 254, 254, 254, 205]), origin=f"[1.0, 2.0, {np.pi / 2}]")
    np.testing.assert_allclose(occupied_centres(grid), [[1.0 - 0.75, 2.0 + 0.25]], atol=1e-12)


def test_negate_swaps_black_and_white(tmp_path: Path) -> None:
    grid = hand_made(tmp_path, bytes([254, 0, 0, 0, 0, 128]), more="negate: 1\nmode: trinary")
    assert occupied_centres(grid) == [[1.25, 2.75]]
    assert np.count_nonzero(grid.free) == 4


@pytest.mark.parametrize(("x", "y"), [(0.01, 0.01), (3.49, 0.01), (0.01, 1.99), (3.49, 1.99), (1.3, 0.7)])
def test_a_wall_at_a_known_place_is_at_the_expected_pixel_and_back(x: float, y: float, tmp_path: Path) -> None:
    cells = np.full((4, 7), -4.0, dtype=np.float32)
    empty = OccupancyGrid(cells, 0.5, np.array([-2.0, 3.0, 0.4]))
    place = np.array([[-2.0 + np.cos(0.4) * x - np.sin(0.4) * y, 3.0 + np.sin(0.4) * x + np.cos(0.4) * y]])
    col, row = np.floor(empty.cell_coordinates(place)[0]).astype(int)
    cells[row, col] = 4.0
    files = write_map(tmp_path / "map", OccupancyGrid(cells, 0.5, empty.origin))
    pixels = np.frombuffer(files.image.read_bytes()[-28:], np.uint8).reshape(4, 7)
    assert pixels[3 - int(y / 0.5), int(x / 0.5)] == 0
    assert np.count_nonzero(pixels == 0) == 1
    centre = np.array(occupied_centres(read_map(files.yaml)))
    assert np.hypot(*(centre - place)[0]) <= 0.5 * np.sqrt(0.5)  # half a cell's diagonal


# What is read from where


def test_yaml_is_read_from_its_image_not_from_the_lossless_grid(tmp_path: Path) -> None:
    files = write_map(tmp_path / "map", asymmetric_grid())
    edited = files.image.read_bytes()[:-1] + bytes([254])  # somebody wiped out the wall's last pixel
    files.image.write_bytes(edited)
    assert states(read_map(files.yaml))[0, 6] == -1
    assert states(read_map(files.lossless))[0, 6] == 1


def test_warnings_name_the_file(tmp_path: Path) -> None:
    hand_made(tmp_path, bytes([0, 254, 205, 205, 205, 254]))
    path = tmp_path / "hand.yaml"
    assert read_map_with_warnings(path).warnings == ()
    path.write_text(path.read_text().replace("0.196", "0.25").replace("negate: 0\n", ""))
    loaded = read_map_with_warnings(path)
    missing, unknown = loaded.warnings
    assert missing == f"{path}: negate is missing, taken as 0"
    assert unknown.startswith(f"{path}: 3 cells of grey 205, usually unknown, are free with free_thresh 0.25, negate 0")
    assert np.count_nonzero(loaded.grid.free) == 5


def test_image_that_is_missing_or_broken_is_refused(tmp_path: Path) -> None:
    files = write_map(tmp_path / "map", asymmetric_grid())
    files.image.write_bytes(files.image.read_bytes()[:-5])
    with pytest.raises(MapFileError, match=r"map\.pgm: 34 bytes that are no"):
        read_map(files.yaml)
    files.image.unlink()
    with pytest.raises(MapFileError, match=r"map\.yaml: its image .*map\.pgm: No such file.*correct 'image'"):
        read_map(files.yaml)


@pytest.mark.parametrize("name", ["map.pgm", "map", "map.txt"])
def test_other_names_than_yaml_and_npz_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=r"expected a \.yaml or \.npz"):
        read_map(tmp_path / name)


# The lossless file


def test_lossless_file_needs_no_pickle_and_is_the_same_bytes_every_time(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_lossless(tmp_path / name, asymmetric_grid(), provenance={"b": "2", "a": "1"})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as data:
        assert sorted(data.files) == ["log_odds", "origin", "provenance", "resolution_m"]
        assert str(data["provenance"]) == '{"a": "1", "b": "2"}'
        assert data["log_odds"].dtype == np.float32


def broken_lossless(path: Path, kind: str) -> None:
    good: dict[str, Any] = {
        "log_odds": np.zeros((2, 2), np.float32),
        "origin": np.zeros(3),
        "resolution_m": 0.05,
        "provenance": "{}",
    }
    write_lossless(path, asymmetric_grid())
    whole = path.read_bytes()
    if kind == "no zip":
        path.write_bytes(b"not a zip")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif kind == "flipped":
        middle = whole.index(b"log_odds") + 60
        path.write_bytes(whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :])
    elif kind == "array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    elif kind == "pickle":
        np.savez(path, **{**good, "log_odds": np.array([{}], dtype=object)})
    elif kind == "no origin":
        np.savez(path, **{key: value for key, value in good.items() if key != "origin"})
    elif kind == "wrong shape":
        np.savez(path, **{**good, "log_odds": np.zeros(4)})
    elif kind == "provenance":
        np.savez(path, **{**good, "provenance": "null"})


@pytest.mark.parametrize(
    "kind",
    ["no zip", "empty", "cut", "flipped", "array", "pickle", "no origin", "wrong shape", "provenance"],
)
def test_broken_lossless_files_are_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    broken_lossless(path, kind)
    with pytest.raises(MapFileError, match="not a lossless map") as caught:
        read_map(path)
    assert "\n" not in str(caught.value)


def test_missing_lossless_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="no such file"):
        read_map(tmp_path / "none.npz")


# Writing


def test_files_are_named_after_the_stem_even_with_dots(tmp_path: Path) -> None:
    files = write_map(tmp_path / "lab.v2", asymmetric_grid(), image_format="png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.v2.npz", "lab.v2.png", "lab.v2.yaml"]
    assert {files.yaml.name, files.image.name, files.lossless.name} == {path.name for path in tmp_path.iterdir()}


def test_a_map_is_replaced_whole(tmp_path: Path) -> None:
    write_map(tmp_path / "map", asymmetric_grid())
    bigger = OccupancyGrid(np.full((9, 5), 3.0, np.float32), 0.1, np.array([5.0, 6.0, 0.0]))
    files = write_map(tmp_path / "map", bigger)
    for path in (files.yaml, files.lossless):
        again = read_map(path)
        assert (again.log_odds.shape, again.resolution_m, again.origin.tolist()) == ((9, 5), 0.1, [5.0, 6.0, 0.0])
    assert len(list(tmp_path.iterdir())) == 3


def test_a_folder_that_cannot_be_written_is_refused_and_the_old_map_stays(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="cannot write the map: No such file"):
        write_map(tmp_path / "absent" / "map", asymmetric_grid())
    files = write_map(tmp_path / "map", asymmetric_grid())
    before = files.lossless.read_bytes()
    (tmp_path / f".map.npz.{os.getpid()}.tmp").mkdir()  # stands where the new file would be prepared
    with pytest.raises(MapFileError, match="cannot write the map"):
        write_map(tmp_path / "map", OccupancyGrid(np.ones((2, 2), np.float32), 0.1, np.zeros(3)))
    assert files.lossless.read_bytes() == before
    np.testing.assert_array_equal(states(read_map(files.yaml)), states(asymmetric_grid()))


def test_a_process_killed_at_any_step_leaves_no_map_or_a_whole_one(tmp_path: Path, project_root: Path) -> None:
    """Kill the writer right before each of its changes to the folder, told by Python's audit events."""
    old, new = np.full((2, 3), 3.0, np.float32), np.full((4, 5), -3.0, np.float32)
    program = """
import os, sys
from pathlib import Path
import numpy as np
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
stem, steps = Path(sys.argv[1]), int(sys.argv[2])
grid = OccupancyGrid(np.full((4, 5), -3.0, np.float32), 0.05, np.array([-9.0, 0.0, 0.0]))
left = [steps]
def watch(event, arguments):
    if event in ("os.rename", "os.remove") and str(stem.parent) in str(arguments[0]):
        if left[0] == 0:
            os._exit(9)
        left[0] -= 1
sys.addaudithook(watch)
write_map(stem, grid)
"""
    outcomes = []
    for steps in range(8):
        folder = tmp_path / str(steps)
        folder.mkdir()
        files = write_map(folder / "map", OccupancyGrid(old, 0.05, np.zeros(3)))
        command = [sys.executable, "-c", program, str(folder / "map"), str(steps)]
        environment = {**os.environ, "PYTHONPATH": str(project_root)}
        result = subprocess.run(command, env=environment, check=False, capture_output=True, text=True)
        assert result.returncode in (0, 9), result.stderr
        for path in (files.yaml, files.lossless):
            if path == files.yaml and not path.exists():
                continue  # better no map than an image under another one's origin
            grid = read_map(path)
            assert (grid.log_odds.shape, grid.origin[0]) in ((old.shape, 0.0), (new.shape, -9.0))
        outcomes.append(result.returncode)
    assert outcomes[0] == 9
    assert outcomes[-1] == 0


# Real maps


REAL_FOLDERS = ["maps_planning", "maps_olin_ac109", "maps_freiburg079_incremental", "maps_strands"]


@pytest.mark.real_data
@pytest.mark.parametrize("folder", REAL_FOLDERS)
def test_real_maps_are_read_or_clearly_refused(folder: str, data_dir: Path, tmp_path: Path) -> None:
    paths = sorted((data_dir / folder).glob("*.yaml"))
    assert paths
    for path in paths:
        if path.name == "movecare_map.yaml":  # names an image that the collection does not hold
            with pytest.raises(MapFileError, match=r"its image .*movecare_map\.pgm: No such file"):
                read_map(path)
            continue
        grid = read_map(path)
        assert np.count_nonzero(grid.free) > np.count_nonzero(grid.occupied) > 500
        again = read_map(write_map(tmp_path / path.stem, grid).yaml)
        np.testing.assert_array_equal(again.log_odds, grid.log_odds)
        np.testing.assert_array_equal(again.origin, grid.origin)


@pytest.mark.real_data
def test_grey_of_the_depot_map_is_free_as_in_nav2_and_warned_of(data_dir: Path) -> None:
    loaded = read_map_with_warnings(data_dir / "maps_planning" / "depot.yaml")
    assert loaded.grid.log_odds.shape == (307, 604)
    assert loaded.grid.known.all()
    assert "8894 cells of grey 205" in loaded.warnings[0]


@pytest.mark.real_data
def test_starts_and_goals_of_real_maps_lie_in_free_space(data_dir: Path) -> None:
    """A flipped or transposed map would put poses into walls: the problems were made on the maps as nav2 reads them."""
    problems = json.loads((data_dir / "maps_planning" / "problems.json").read_text())
    for name, content in problems.items():
        grid = read_map(data_dir / "maps_planning" / f"{name}.yaml")
        poses = np.array([[problem["start"], problem["goal"]] for problem in content]).reshape(-1, 3)
        cols, rows = np.floor(grid.cell_coordinates(poses[:, :2])).astype(int).T
        assert grid.free[rows, cols].all()
        rows_flipped = grid.log_odds.shape[0] - 1 - rows
        assert not grid.free[rows_flipped, cols].all()


@pytest.mark.parametrize(("resolution_m", "says"), [(50.0, "0.05 if mm"), (20.0, "0.05 if cells a metre"), (1e-4, "?")])
def test_a_resolution_that_no_building_s_map_has_is_told(tmp_path, resolution_m, says):
    grid = OccupancyGrid(np.full((20, 30), -5.0, np.float32), 0.05, np.zeros(3))
    assert read_map_with_warnings(write_map(tmp_path / "a", grid).yaml).warnings == ()
    files = write_map(tmp_path / "b", OccupancyGrid(grid.log_odds, resolution_m, np.zeros(3)))
    for path in (files.yaml, files.lossless):
        (warning,) = read_map_with_warnings(path).warnings
        assert says in warning
        assert f"{30 * resolution_m:.3g} m x {20 * resolution_m:.3g} m" in warning


@pytest.mark.parametrize(
    ("resolution_m", "x_m", "key"), [(1e-300, 0.0, "resolution"), (1e300, 0.0, "resolution"), (0.05, -1e300, "origin")]
)
def test_a_map_that_no_metres_can_hold_is_refused(tmp_path, resolution_m, x_m, key):
    grid = OccupancyGrid(np.full((3, 4), -5.0, np.float32), resolution_m, np.array([x_m, 0.0, 0.0]))
    files = write_map(tmp_path / "a", grid)
    for path in (files.yaml, files.lossless):
        with pytest.raises(MapFileError, match=f"{key} is"):
            read_map(path)
