"""What was merged is known again after a new start."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment, Alternative
from fusion.readiness import GrowingPair, Version
from tools.growing_history import HISTORY_NAME, read_history, write_history

FOUND = Alignment(
    np.array([1.0 / 3.0, 2.0, -0.5]),
    True,
    "sure",
    probability=0.99,
    covariance=np.diag([0.1, 0.2, 0.3]),
    alternatives=(Alternative(np.zeros(3), 0.01),),
    common_wall_m=12.5,
    slide=(0.1, 0.2),
)
POINTS = np.array([[0.0, 0.0], [5.0, 5.0]])


def test_pairs_are_read_back_as_they_were_and_go_on(tmp_path):
    merged = GrowingPair()
    for wall_m in (10.0, 20.0, 30.0):
        merged = merged.registered(Version(FOUND, wall_m, 0.1), POINTS)
    pairs = {("a", "b"): merged, ("a", "c"): GrowingPair()}
    write_history(tmp_path, pairs)
    again = read_history(tmp_path)
    assert list(again) == [("a", "b"), ("a", "c")]
    assert again["a", "c"].last is None
    pair = again["a", "b"]
    assert (pair.refused, pair.withdrawn, pair.reason) == (0, "", merged.reason)
    assert [version.wall_m for version in pair.versions] == [10.0, 20.0, 30.0]
    assert pair.merged is not None
    np.testing.assert_array_equal(pair.merged.T_a_b, FOUND.T_a_b)
    np.testing.assert_array_equal(pair.merged.covariance, FOUND.covariance)
    same_maps = pair.registered(Version(FOUND, 30.0, 0.1), POINTS)
    assert same_maps.merged is not None
    assert len(same_maps.versions) == 3


@pytest.mark.parametrize("content", ["", "{", "[]", '{"format": "x", "version": 1, "pairs": []}', '{"format": 1}'])
def test_a_damaged_file_is_told_and_pairs_settle_anew(tmp_path, content, caplog):
    (tmp_path / HISTORY_NAME).write_text(content)
    assert read_history(tmp_path) == {}
    assert "settle anew" in caplog.text


def test_without_a_file_there_is_nothing_to_tell(tmp_path, caplog):
    assert read_history(tmp_path) == {}
    assert not caplog.text
