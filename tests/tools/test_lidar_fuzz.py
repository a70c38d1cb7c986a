from __future__ import annotations

import numpy as np

from drivers.messages import LaserScan
from tools.lidar_fuzz import decode_noise, fuzz, noise, parse_noise
from tools.lidar_streams import STREAM_KINDS


def test_a_short_run_raises_nothing_and_decodes_something():
    report = fuzz(1.0, seed=3)
    assert report.streams >= 1
    assert 0 < report.refused < report.answers
    assert report.seconds >= 1.0


def test_a_seed_is_a_run():
    made = [[noise(kind, random) for kind in STREAM_KINDS] for random in (np.random.default_rng(9) for _ in range(2))]
    assert made[0] == made[1]


def test_every_kind_takes_noise():
    random = np.random.default_rng(11)
    scans = sum(decode_noise(kind, noise(kind, random), random) for kind in STREAM_KINDS for _ in range(8))
    assert scans > 0
    assert {parse_noise(random) for _ in range(200)} == {False, True}


def test_a_scan_that_cannot_be_is_found_out():
    import pytest

    from tools.errors import ToolError
    from tools.lidar_fuzz import check_scans

    backwards = LaserScan(0, np.zeros(2), np.ones(2), np.array([0.0, -1.0]), 0.1, 12.0)
    with pytest.raises(ToolError):
        check_scans([backwards])
