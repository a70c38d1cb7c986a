"""Plots of chapter 4: each is a picture with something on it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from tools.feature_plots import HeatMap, Line, Panel, draw_heat_maps, draw_panels


@pytest.mark.parametrize("log", [False, True])
def test_panels_are_drawn_with_gaps_and_names_on_x(tmp_path, log):
    lines = [Line("KAZE", [0, 1, 2], [1.0, math.nan, 3.0]), Line("ORB", [0, 1, 2], [2.0, 2.0, 90.0])]
    panels = [Panel("error", lines, "T in Hz", "deg", log, ("0.3", "0.2", "0.1"))] * 2
    draw_panels(tmp_path / "a.png", panels, 2, "a title")
    draw_panels(tmp_path / "b.png", panels[:1], 2, "a title")
    whole, half = (cv2.imread(str(tmp_path / name), cv2.IMREAD_GRAYSCALE) for name in ("a.png", "b.png"))
    assert whole is not None
    assert half is not None
    assert whole.shape == half.shape
    right = slice(whole.shape[1] * 3 // 4, None)  # the second panel's half
    assert np.count_nonzero(whole[60:-60, right] < 128) > 100
    assert not np.count_nonzero(half[60:-60, right] < 128)


def test_a_matrix_is_drawn_with_its_numbers(tmp_path):
    values = np.array([[1.0, 0.2], [np.nan, 1.0]])
    for name, texts in (("a.png", [["1.00", "0.20"], ["-", "1.00"]]), ("b.png", [["", ""], ["", ""]])):
        draw_heat_maps(tmp_path / name, [HeatMap("SIFT", values, texts, 1.0)], 1, ["8", "20"], ("x", "y"), "t")
    with_numbers, without = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert with_numbers is not None
    assert without is not None
    assert (with_numbers != without).any(axis=2).sum() > 100
