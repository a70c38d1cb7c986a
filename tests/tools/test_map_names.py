"""Short names of map files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.map_names import plain, short_names


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["x/east.yaml", "x/west.npz"], ["east", "west"]),
        (["monday/map.yaml", "tuesday/map.npz"], ["monday", "tuesday"]),
        (["x/a.yaml", "y/a.yaml", "y/b.yaml"], ["x-a", "y-a", "b"]),
        (["1/x/map.yaml", "2/x/map.yaml"], ["1-x-map", "2-x-map"]),
        (["x/a.yaml", "x/a.npz"], ["1-x-a", "2-x-a"]),
    ],
)
def test_no_two_files_have_one_name(files, names):
    assert short_names([Path(file) for file in files]) == names


def test_names_are_good_for_files():
    assert plain("Käthes Auto (2)/neu") == "Käthes-Auto-2-neu"
    assert plain("...") == "map"
