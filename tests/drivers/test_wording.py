from __future__ import annotations

from drivers.wording import counted


def test_one_is_singular_and_all_else_plural():
    assert [counted(number, "file") for number in (0, 1, 2)] == ["0 files", "1 file", "2 files"]
