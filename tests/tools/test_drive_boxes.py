"""Where a box may be put; a whole drive past one is in test_closed_loop."""

from __future__ import annotations

import numpy as np
import pytest

from planning.path import path_along
from tools.drive_boxes import place_ahead, told_box

LINE = path_along(np.column_stack([np.arange(0.0, 4.001, 0.01), np.zeros(401), np.zeros(401)]))
FAR = np.array([0.0, 5.0, 0.0])


def test_the_box_stands_on_the_path_so_far_ahead():
    place = place_ahead(LINE, 1.5, (FAR,))
    assert place is not None
    np.testing.assert_allclose(place, [1.5, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize("end", [[2.2, 0.3, 0.0], [0.9, 0.0, 0.0]])
def test_not_near_to_the_goal_or_the_car(end):
    assert place_ahead(LINE, 1.5, (FAR, np.array(end))) is None


def test_not_beyond_the_end():
    assert place_ahead(LINE, 4.5, (FAR,)) is None


def test_what_is_said_of_a_drive():
    row = {"state": "arrived", "paths": 2, "contacts": 0, "notes": ["a", "b", "c", "d"]}
    assert told_box(row) == "arrived, 2 paths, 0 contacts, ['a', 'b', 'c']"
