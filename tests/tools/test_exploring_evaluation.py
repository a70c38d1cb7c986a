"""A whole drive into a part of a room that was not seen from the start: some seconds of computing."""

from __future__ import annotations

import numpy as np
import pytest

from planning.costmap import Costmap
from planning.plan import PlanResult, PlanSettings, plan
from tools.exploring_evaluation import ExploringCase, explore, line_of, usual_cases
from tools.wall_contact import Room
from tools.world import World


def find_path(known: Costmap, start: np.ndarray, goal: np.ndarray) -> PlanResult:
    return plan(known, start, goal, PlanSettings(iterations=50), seed=0, clock=lambda: 0.0)


def test_a_car_drives_round_a_wall_to_a_place_that_it_had_not_seen():
    occupied = np.zeros((200, 250), np.bool_)  # 5 m x 4 m
    occupied[[0, 1, -2, -1], :] = True
    occupied[:, [0, 1, -2, -1]] = True
    occupied[:130, 120:126] = True
    occupied[150:170, 20:50] = True
    case = ExploringCase("room", World(occupied, 0.02, np.zeros(3)), (1.0, 1.0, 0.3), ((3.9, 0.9, -1.4),))
    between = np.linspace(case.start[:2], case.goals[0][:2], 200)
    assert occupied[(between[:, 1] / 0.02).astype(int), (between[:, 0] / 0.02).astype(int)].any()  # out of sight
    row = explore(case, 4, find_path)
    assert row["arrived"] is True
    assert (row["reached"], row["contacts"]) == (1, 0)
    assert row["driven_m"] > 3.5
    assert "1 of 1 goals reached" in line_of(row)


@pytest.mark.parametrize("case", usual_cases(), ids=lambda case: case.name)
def test_starts_and_goals_have_room(case):
    room = Room(case.world)
    assert all(room(np.array(pose)) for pose in (case.start, *case.goals))


def test_contacts_are_said():
    row = {
        "name": "a", "reached": 0, "goals": 1, "away_m": 1.0, "turned_deg": 9.0, "driven_m": 1.0, "driven_s": 3.0,
        "paths": 1, "contacts": 4,
    }  # fmt: skip
    assert "4 poses in walls" in line_of(row)
