"""Two robots' maps that grow, parts of a real drive: merged once they have settled, and rightly."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.evaluation import alignment_error, free_points
from fusion.readiness import GrowingPair, Version
from fusion.registration import register
from mapping import se2
from tools.growing_maps import late_parts, versions
from tools.real_maps import LOG_REACH_M, read_corrected_log

STEPS = 8


@pytest.mark.real_data
def test_two_parts_of_a_drive_are_merged_late_and_rightly(data_dir):
    path = data_dir / "carmen_ple/freiburg-101-corrected.log.gz"
    scans = read_corrected_log(path, LOG_REACH_M["freiburg-101"])
    parts = late_parts(scans, np.random.default_rng(1))
    frames = [np.array([5.0, -8.0, 2.0]), np.array([-3.0, 1.0, -1.0])]
    step_m = max(float(part.driven_m[-1]) for part in parts) / STEPS
    ways = [versions(part, 0.05, frame, step_m) for part, frame in zip(parts, frames, strict=True)]
    true_T_a_b = se2.compose(frames[0], se2.inverse(frames[1]))
    pair, merged = GrowingPair(), 0
    for a, b in list(zip(*ways, strict=False))[STEPS // 2 :]:  # there is little in common before
        pair = pair.registered(Version.of(register(a, b)), free_points(b))
        if pair.merged is not None:
            assert pair.merged.T_a_b is not None
            error = alignment_error(a, b, pair.merged.T_a_b, true_T_a_b)
            assert error.rms_m < 0.1
            assert error.rotation_deg < 0.5
            merged += 1
    assert merged > 0
