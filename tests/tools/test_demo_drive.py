"""How a drive of the demo is scored and told; that it drives is shown by the demo's own test."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from mapping.trajectory import Trajectory
from tools import processes
from tools.demo_drive import DriveOutcome, DriveWanted, drive_line, drive_to_goal, score_drive
from tools.errors import ToolError

GOAL = np.array([2.0, 1.0, np.pi / 2.0])


def outcome(end: tuple[float, float, float], code: int = 0, contacts: int = 0) -> DriveOutcome:
    """A car that stands for 1 s, drives 2 m in 4 s, and stands for 5 s."""
    way = np.concatenate([np.zeros(20), np.linspace(0.0, 2.0, 81), np.full(100, 2.0)])
    poses = np.tile(end, (len(way), 1))
    poses[:, 1] += way - 2.0
    return DriveOutcome(code, Trajectory(np.arange(len(way)) * 50_000_000, poses), contacts)


def test_the_score_is_where_the_car_really_stands():
    scored = score_drive(outcome((2.03, 1.04, np.pi / 2.0 - 0.1)), GOAL)
    assert scored["arrived"] is True
    assert scored["away_m"] == pytest.approx(0.05)
    assert scored["turned_deg"] == pytest.approx(np.degrees(0.1), abs=0.01)
    assert scored["driven_m"] == pytest.approx(2.0)
    assert scored["driven_s"] == pytest.approx(4.0)
    assert "5.0 cm and 5.7 deg off, no contact" in drive_line(scored)


@pytest.mark.parametrize(
    ("end", "code"), [((2.2, 1.0, np.pi / 2.0), 0), ((2.0, 1.0, 1.2), 0), ((2.0, 1.0, np.pi / 2.0), 3)]
)
def test_who_is_elsewhere_or_does_not_say_so_has_not_arrived(end, code):
    assert score_drive(outcome(end, code), GOAL)["arrived"] is False


def test_contacts_and_a_drive_that_ended_on_the_way_are_said():
    assert "2 CONTACTS" in drive_line(score_drive(outcome((2.0, 1.0, np.pi / 2.0), contacts=2), GOAL))
    assert "NOT arrive" in drive_line(score_drive(outcome((0.0, 1.0, 0.0), code=3), GOAL))


# A program in place of this one: a car that never moves, and a run that ends with a code of its choice.
STAND_IN = """
import json, signal, sys, time
from pathlib import Path
def say(**event): print(json.dumps(event), flush=True)
def stop(*_):
    Path(sys.argv[sys.argv.index("--truth") + 1]).write_text("1.0 3 4 0 0 0 0 1\\n2.0 3 4 0 0 0 0 1\\n")
    say(event="stopped", contacts=1)
    sys.exit(0)
if "run" in sys.argv:
    sys.exit(CODE)
signal.signal(signal.SIGINT, stop)
say(event="ready", vehicle="udpout:127.0.0.1:9")
time.sleep(60)
"""


@pytest.mark.parametrize("code", [0, 3, 4])
def test_what_the_two_processes_say_is_the_outcome(code, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "ENTRY", STAND_IN.replace("CODE", str(code)))
    wanted = DriveWanted(np.zeros(3), GOAL, "wings", np.array([3.0, 4.0, 0.0]))
    told: list[str] = []
    arguments = (tmp_path / "drive", tmp_path / "map.npz", wanted, 0, lambda: False, told.append)
    if code == 4:
        with pytest.raises(ToolError, match="exit code 4"):
            drive_to_goal(*arguments)
        return
    found = drive_to_goal(*arguments)
    assert (found.code, found.contacts) == (code, 1)
    np.testing.assert_allclose(found.truth.poses[-1], [3.0, 4.0, 0.0], atol=1e-9)
    assert "--vehicle udpout:127.0.0.1:9" in told[0]
    assert f"--goal 2.000 1.000 {np.pi / 2.0:.3f}" in told[0]


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="signals")
