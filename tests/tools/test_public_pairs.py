"""The public set: its warped pairs, and its pairs of different buildings, from the data sets themselves."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from mapping.map_io import read_map
from tools.errors import ToolError
from tools.other_buildings import FINISHED, FIRST, BuildingMap
from tools.pair_overlap import common_wall_m, wall_line
from tools.public_pairs import finished_maps, halmstad_maps, halmstad_pairs, other_building_pairs, public_pairs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("maps")


@pytest.fixture(scope="module")
def warped(data_dir, folder):
    return halmstad_maps(folder, data_dir / "maps_halmstad", np.random.default_rng(0))


@pytest.mark.real_data
def test_warped_pairs_are_those_of_one_building_and_their_truth_joins_the_walls(data_dir, warped):
    flats = {name: each for name, each in warped.items() if not name.startswith("F5")}
    pairs = halmstad_pairs(data_dir / "maps_halmstad", flats)
    assert Counter(pair.building_a for pair in pairs) == {"HIH": 6, "KPT4A": 6}
    for pair in pairs:
        assert pair.building_a == pair.building_b
        assert pair.truth is not None
        assert pair.common_wall_m is not None
        lines = [wall_line(read_map(path)) for path in (pair.a, pair.b)]
        turned = np.array([pair.truth.T_a_b[0], pair.truth.T_a_b[1], pair.truth.T_a_b[2] + 0.5])
        assert pair.common_wall_m > 1.5 * common_wall_m(lines[0], lines[1], turned)
        assert pair.truth.right_m > 15 * 0.02


@pytest.mark.real_data
def test_pairs_of_different_buildings_are_many_and_varied(data_dir, folder, warped):
    finished = finished_maps(folder, data_dir, np.random.default_rng(1))
    some = next(iter(warped.values()))[0]
    drives = [
        BuildingMap(
            building, some.path.with_name(f"{building}-{kind}-{resolution_m}-{number}.yaml"), kind, resolution_m
        )
        for building in ("belgioioso", "csail", "edmonton")
        for kind, resolution_m in ((FIRST, 0.05), (FIRST, 0.04), ("lidar", 0.05), ("resolution", 0.1), ("camera", 0.05))
        for number in range(9)
    ]
    pairs = other_building_pairs(drives, [each for each, _ in warped.values()], finished, np.random.default_rng(2))
    assert len(pairs) >= 300
    assert all(pair.building_a != pair.building_b and pair.truth is None for pair in pairs)
    assert min(Counter(pair.kind for pair in pairs).values()) >= 45
    assert len({pair.building_a for pair in pairs} | {pair.building_b for pair in pairs}) >= 14
    assert all(each.kind == FINISHED and read_map(each.path).known.any() for each in finished)


def test_a_folder_without_the_data_is_told(tmp_path):
    with pytest.raises(ToolError, match="carmen_ple"):
        public_pairs(tmp_path, tmp_path, 0, 1, print)
