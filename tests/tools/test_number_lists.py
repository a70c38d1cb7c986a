"""Lists of numbers on the command line."""

from __future__ import annotations

import pytest

from tools.errors import UsageError
from tools.number_lists import positive_numbers


def test_numbers_come_once_and_rising():
    assert positive_numbers("20,8,8,12.5", float, "--x") == (8.0, 12.5, 20.0)
    assert positive_numbers("4,1", int, "--x") == (1, 4)


@pytest.mark.parametrize("text", ["", "8,,9", "0,8", "-1", "8;9", "1001", "nan"])
def test_anything_else_is_refused_by_the_name_of_the_option(text):
    with pytest.raises(UsageError, match="--cells-per-meter"):
        positive_numbers(text, float, "--cells-per-meter")
