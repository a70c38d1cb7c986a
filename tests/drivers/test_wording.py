from __future__ import annotations

import pytest

from drivers.wording import counted, fault_in


def test_one_is_singular_and_all_else_plural():
    assert [counted(number, "file") for number in (0, 1, 2)] == ["0 files", "1 file", "2 files"]


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (UnicodeDecodeError("utf-8", b"\xff" * 5000, 0, 1, "bad"), "it is no text"),
        (KeyError("world"), "'world' is missing"),
        (IsADirectoryError(21, "Is a directory"), "Is a directory"),
        (ValueError("two\nlines"), "two lines"),
        (TypeError(), "TypeError"),
    ],
)
def test_faults_are_short_words(error, says):
    assert fault_in(error) == says


def test_a_recital_is_cut():
    assert len(fault_in(ValueError("x" * 5000))) < 200
