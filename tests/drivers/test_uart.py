from __future__ import annotations

import numpy as np
import pytest

from drivers.uart import misread


def test_the_right_speed_changes_nothing() -> None:
    assert misread(b"\xa5\x50", 115200, 115200) == b"\xa5\x50"


def test_a_small_speed_error_is_tolerated() -> None:
    data = bytes(range(256))
    assert misread(data, 115200, 117000) == data


@pytest.mark.parametrize(("sent", "heard"), [(115200, 256000), (256000, 115200)])
def test_a_wrong_speed_scrambles_and_changes_the_length(sent: int, heard: int) -> None:
    data = np.random.default_rng(0).integers(0, 256, 1000, dtype=np.uint8).tobytes()
    noise = misread(data, sent, heard)
    assert noise == misread(data, sent, heard)
    assert (len(noise) > len(data)) == (heard > sent)
    assert len(noise) > 200
    assert noise[:100] != data[:100]
    assert misread(b"\xa5\x50", sent, heard) != b"\xa5\x50"


def test_speed_zero_is_hung_up() -> None:
    assert misread(b"abc", 115200, 0) == b""
