"""Occupied cells of several merges over each other."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tools.merging_plots import MergedPoints, MergePanel, draw_merged_points


def wall(y: float) -> np.ndarray:
    return np.column_stack([np.linspace(0.0, 12.0, 200), np.full(200, y)])


@pytest.mark.parametrize("panels", [1, 2])
def test_methods_that_merged_have_panels_beside_each_other(tmp_path, panels):
    merged = MergePanel("one", [MergedPoints("r_b = 20", wall(1.0)), MergedPoints("r_b = 10", wall(1.1))])
    refused = MergePanel("none", [MergedPoints("r_b = 20: refused", np.empty((0, 2)))])
    draw_merged_points(tmp_path / "a.png", [merged, refused])
    draw_merged_points(tmp_path / "b.png", [merged] * panels)
    one, other = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert other.shape[1] == pytest.approx(panels * one.shape[1], rel=0.02)


def test_refused_everywhere_is_a_picture_too(tmp_path):
    draw_merged_points(tmp_path / "a.png", [MergePanel("none", [MergedPoints("refused", np.empty((0, 2)))])])
    assert cv2.imread(str(tmp_path / "a.png")).std() > 1.0
