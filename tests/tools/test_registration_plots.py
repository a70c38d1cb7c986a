"""Plots of an evaluation: each draws whatever the rows hold."""

from __future__ import annotations

import cv2
import pytest

from tools.registration_plots import draw_reliability, draw_scores, draw_success
from tools.registration_scores import summary_of

TRUE = {
    "pair": "x", "kind": "lidar", "band": "low", "building_a": "hall", "building_b": "hall", "true": True,
    "common_wall_m": 10.0, "aligned": True, "accepted": True, "probability": 0.97, "acceptance": 0.9, "rms_m": 0.02,
    "rotation_deg": 0.1, "nees": 2.0, "reason": "as told", "cpu_s": 1.0,
}  # fmt: skip
MISSED = TRUE | {"aligned": False, "accepted": False, "probability": 0.2}
WRONG = TRUE | {"true": False, "aligned": False, "accepted": False, "probability": 0.01, "band": None}
SILENT = [each | {"probability": None} for each in (TRUE, WRONG)]


@pytest.mark.parametrize("rows", [[TRUE, MISSED, WRONG], SILENT, [WRONG], [TRUE]])
def test_every_plot_is_a_picture_with_something_on_it(rows, tmp_path):
    report = summary_of(rows)
    draw_success(tmp_path / "success.png", report)
    draw_reliability(tmp_path / "reliability.png", report)
    draw_scores(tmp_path / "scores.png", report, rows)
    for name in ("success", "reliability", "scores"):
        image = cv2.imread(str(tmp_path / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        assert image.std() > 5.0
