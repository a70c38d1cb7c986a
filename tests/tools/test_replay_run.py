from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tools.replay_run import closing_line

COUNTS = {"received": 125, "mapped": 90, "unmatched": 35, "skipped_partial": 0, "skipped_out_of_order": 0, "in_map": 75}


def report_of(**changes: Any) -> dict[str, Any]:
    trajectory = {"duration_s": 10.0, "length_m": 3.2}
    return {"scans": COUNTS | changes, "trajectory": trajectory, "timing": {"per_scan_ms_median": 9.0}}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, "75 of 125 images mapped, 35 unmatched, 15 in pieces without a place in the map in"),
        ({"mapped": 125, "in_map": 125, "unmatched": 0}, "125 of 125 images mapped in"),
        ({"mapped": 63, "in_map": 63, "unmatched": 0}, "63 of 125 images mapped, 62 passed over in"),
    ],
)
def test_the_closing_line_accounts_for_every_image(changes, says):
    assert says in closing_line(report_of(**changes), Path("out"), 5.0)


def test_scans_of_a_lidar_are_called_scans():
    report = report_of(mapped=125, in_map=125, unmatched=0) | {"scan_source": "/scan"}
    assert "125 of 125 scans mapped" in closing_line(report, Path("out"), 5.0)
