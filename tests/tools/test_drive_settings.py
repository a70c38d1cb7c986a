from __future__ import annotations

import math

import pytest

from planning.errors import PlanningError
from tools.drive_settings import AutopilotSettings


@pytest.mark.parametrize(
    "wrong",
    [
        {"margins_m": ()},
        {"margins_m": (0.02, -0.01)},
        {"check_m": 0.0},
        {"back_m": math.inf},
        {"pause_s": -0.1},
        {"tries": 0},
        {"back_offs": -1},
    ],
)
def test_values_that_make_no_sense_are_refused_by_name(wrong):
    with pytest.raises(PlanningError, match=next(iter(wrong))):
        AutopilotSettings(**wrong)


def test_without_a_pause_and_backing_off_is_allowed():
    assert AutopilotSettings(pause_s=0.0, back_offs=0).pause_s == 0.0
