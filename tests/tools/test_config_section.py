"""What all sections of the configuration refuse."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from tools.config_section import Section


class Wheel(Section):
    radius_m: float = 0.03


def test_a_section_is_frozen_and_knows_its_keys_and_finite_numbers_only():
    wheel = Wheel(radius_m=0.05)
    with pytest.raises(ValidationError, match="frozen"):
        wheel.radius_m = 0.06  # type: ignore[misc]
    with pytest.raises(ValidationError, match="width_m"):
        Wheel.model_validate({"width_m": 1.0})
    with pytest.raises(ValidationError, match="finite"):
        Wheel(radius_m=math.nan)
