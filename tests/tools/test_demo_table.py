"""The demo's table says what the report holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.demo_table import table

CAR = {
    "name": "A", "model": "A2M8", "resolution_m": 0.04, "driven_m": 20.0, "driven_s": 40.0, "decoded": 99,
    "emitted": 100,
    "scans_hz": 10.0, "mapped_scans": 400, "dropped_scans": 0, "rms_m": 0.012, "max_m": 0.03, "identical": True,
}  # fmt: skip
DRIVE = {
    "arrived": True, "exit_code": 0, "away_m": 0.034, "turned_deg": 2.1, "contacts": 0,
    "driven_m": 11.5, "driven_s": 31.0,
}  # fmt: skip
REPORT = {
    "cars": [CAR],
    "common": {"overlap": 0.33, "free_m2": 20.0, "wall_m": 29.0},
    "alignment": {"accepted": True, "frames_apart_m": 16.9, "frames_apart_deg": 84.0, "rms_m": 0.03,
                  "rotation_deg": 0.1, "seconds": 2.0},
    "camera": {"accepted": False, "reason": "too little", "seconds": 1.0, "rms_m": None, "rms_between_maps_m": None,
               "rotation_deg": None, "driven_m": 10.0, "trajectory_rms_m": 0.05},
    "plan": {"solved": True, "error": None, "length_m": 11.2, "seconds": 0.05},
    "drive": DRIVE,
    "seconds": 180.0,
}  # fmt: skip


def test_the_drive_is_told_beside_its_plan():
    text = table(Path("demo"), REPORT)
    assert text.startswith("Simulated data")
    assert "11.2 m, found in 0.05 s" in text
    assert "11.5 m in 31 s, 3.4 cm and 2.1 deg off, no contact" in text
    assert "33% of the smaller map's free space" in text


@pytest.mark.parametrize("drive", [None, DRIVE | {"contacts": 1}])
def test_what_went_wrong_is_told(drive):
    plan = {"solved": drive is not None, "error": "NOT_FUSED", "length_m": 1.0, "seconds": 0.0}
    text = table(Path("demo"), REPORT | {"plan": plan, "drive": drive})
    assert ("NOT_FUSED" if drive is None else "1 CONTACTS") in text
