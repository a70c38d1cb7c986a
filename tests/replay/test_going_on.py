"""Two recordings of one simulated office: the second goes on with the first one's map, or finds itself on it."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.errors import MappingError
from mapping.metrics import absolute_trajectory_error
from mapping.slam_state import read_state
from mapping.trajectory import Trajectory, read_tum
from tools.localisation import LOCALISED_NAME

FIRST, SECOND = "simulated_office_a2m8", "simulated_office_a2m12"  # in the order in which they were made


@pytest.fixture(scope="module")
def earlier(replayed_once):
    return replayed_once(FIRST)[0]


@pytest.fixture(scope="module")
def gone_on(replay, earlier):
    """Folder and report of the second drive on the first one's map."""
    return replay(SECOND, resume=read_state(earlier), save_state=True)


@pytest.fixture(scope="module")
def truth(project_root):
    first, second = (read_tum(project_root / f"recordings/{name}.truth.tum") for name in (FIRST, SECOND))
    before = first.stamps_ns < second.stamps_ns[0]
    stamps_ns = np.concatenate([first.stamps_ns[before], second.stamps_ns])
    return Trajectory(stamps_ns, np.vstack([first.poses[before], second.poses]))


def test_a_drive_that_goes_on_is_one_map_with_the_earlier_one(replay, earlier, gone_on, truth, project_root):
    folder, report = gone_on
    assert [piece["in_map"] for piece in report["slam"]["segments"]] == [True, True]
    trajectory, before = read_tum(folder / "trajectory.tum"), read_tum(earlier / "trajectory.tum")
    assert len(trajectory) > len(before) + 200
    departure_ns = read_tum(project_root / f"recordings/{SECOND}.truth.tum").stamps_ns[0]
    on_record = (trajectory.stamps_ns >= departure_ns) | (trajectory.stamps_ns <= before.stamps_ns[-1])
    error = absolute_trajectory_error(Trajectory(trajectory.stamps_ns[on_record], trajectory.poses[on_record]), truth)
    assert error.max_m < 0.05
    assert error.max_deg < 1.0
    again, _ = replay(SECOND, resume=read_state(earlier))
    assert (again / "trajectory.tum").read_bytes() == (folder / "trajectory.tum").read_bytes()


def test_a_drive_cannot_go_on_from_a_later_one(replay, gone_on):
    later, _ = gone_on
    with pytest.raises(MappingError, match="clock"):
        replay(FIRST, resume=read_state(later))


def test_the_car_is_found_on_a_saved_map(replay, earlier, truth):
    folder, report = replay(SECOND, map_file=earlier / "map.yaml")
    assert report["localisation"]["found"]
    assert report["localisation"]["poses"] > 150
    first = read_tum(earlier / "trajectory.tum")
    T_world_map = se2.compose(truth.at(first.stamps_ns[:1])[0], se2.inverse(first.poses[0]))
    found = read_tum(folder / LOCALISED_NAME)
    off = se2.between(truth.at(found.stamps_ns), se2.compose(T_world_map, found.poses))
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.10
    assert np.degrees(np.abs(off[:, 2])).max() < 2.0
