from __future__ import annotations

import pytest

from tools.json_values import number_or_none, relative_path


@pytest.mark.parametrize(("value", "number"), [(None, None), (3, 3.0), (-0.5, -0.5)])
def test_a_number_may_be_unknown(value, number):
    assert number_or_none(value) == number


@pytest.mark.parametrize("value", ["3", [1.0], float("nan"), float("inf")])
def test_nothing_else_is_a_number(value):
    with pytest.raises(ValueError, match="expected a number or null"):
        number_or_none(value)


def test_a_path_is_told_from_the_folder_of_its_list(tmp_path):
    assert relative_path(tmp_path / "set/maps/a.npz", tmp_path / "set") == "maps/a.npz"
    assert relative_path(tmp_path / "a.npz", tmp_path / "set") == "../a.npz"
