"""What chapter 5's experiments set beside each other."""

from __future__ import annotations

from fusion.algorithm3 import THESIS
from tools.merging_methods import METHODS


def test_the_thesis_has_its_own_numbers_on_the_cell_of_the_fixed_map():
    settings = METHODS["thesis"].registration.settings
    for key in ("alpha", "max_ratio", "tolerance_px", "trials", "rule", "confidence"):
        assert getattr(settings, key) == getattr(THESIS, key)
    assert (settings.alpha, settings.max_ratio, settings.common_cell) == (0.99, 0.6, "fine")


def test_titles_say_what_differs():
    settings = METHODS["real"].registration.settings
    assert settings.alpha is not None
    said = f"alpha {settings.alpha:g}, ratio {settings.max_ratio:g}, {settings.tolerance_px:g} px"
    assert f"{said}, {settings.trials} trials" in METHODS["real"].title
    assert settings.rule == THESIS.rule
    assert METHODS["default"].registration.method == "default"
