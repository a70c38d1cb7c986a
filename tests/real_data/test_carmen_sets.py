"""The classic CARMEN logs with their manually checked relations."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.carmen_log import CarmenLog
from drivers.messages import LaserScan, Odometry, Transform
from drivers.recording_reader import open_recording
from mapping import se2
from mapping.relations import read_relations, relation_errors
from mapping.trajectory import Trajectory, read_tum
from tools.config import Config
from tools.replay_run import replay_recording

pytestmark = pytest.mark.real_data

# Published errors of the raw odometry (Kuemmerle et al. 2009, recomputed): mean and std, m and deg. They are of the
# laser's poses, which only in fr079 differ from the robot's.
BASELINES = {"intel": (7.370, 14.349, 39.17, 53.79), "fr079": (6.507, 13.657, 30.29, 45.52)}


def recorded_laser_poses(log: CarmenLog) -> Trajectory:
    """The laser's poses by the log's own odometry, at the scans' stamps."""
    mount, odometry, poses = np.zeros(3), np.zeros(3), {}
    for message in log:
        if isinstance(message, Transform):
            mount = np.array([*message.translation[:2], 2 * np.arctan2(message.quaternion[2], message.quaternion[3])])
        elif isinstance(message, Odometry):
            odometry = message.pose
        elif isinstance(message, LaserScan):
            poses[message.stamp_ns] = se2.compose(odometry, mount)
    stamps = sorted(poses)
    return Trajectory(np.array(stamps, dtype=np.int64), np.array([poses[stamp] for stamp in stamps]))


@pytest.mark.parametrize("name", sorted(BASELINES))
def test_evaluator_reproduces_the_raw_odometry_baseline(name, data_dir):
    with CarmenLog(data_dir / f"radish_freiburg/{name}.clf.bz2") as log:
        trajectory = recorded_laser_poses(log)
    errors = relation_errors(trajectory, read_relations(data_dir / f"freiburg_relations_xiaofeng/{name}.relations"))
    assert errors.unmatched == 0
    found = (errors.mean_m, errors.std_m, errors.mean_deg, errors.std_deg)
    assert found == pytest.approx(BASELINES[name], abs=0.006)


def test_building_079_is_mapped_as_well_as_it_must_be(data_dir, tmp_path):
    with open_recording(data_dir / "radish_freiburg/fr079.clf.bz2") as recording:
        report = replay_recording(recording, Config(), tmp_path, on_progress=lambda _: None)
    assert report["scans"]["received"] == 4934
    assert report["scans"]["mapped"] > 0.999 * 4934
    assert [piece["in_map"] for piece in report["slam"]["segments"]] == [True]
    relations = read_relations(data_dir / "freiburg_relations_xiaofeng/fr079.relations")
    errors = relation_errors(read_tum(tmp_path / "trajectory.tum"), relations)
    assert errors.unmatched == 0
    # 0.031 m and 0.45 deg when this was written; Cartographer's published figures are about 0.045 m and 0.54 deg.
    assert errors.mean_m < 0.044
    assert errors.mean_deg < 0.50
