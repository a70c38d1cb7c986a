from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.errors import RelationsError
from mapping.relations import Relations, read_relations, relation_errors
from mapping.trajectory import Trajectory


def drive(count=20):
    steps = np.tile([0.5, 0.0, 0.2], (count, 1))
    poses = [np.zeros(3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step))
    return Trajectory(np.arange(count, dtype=np.int64) * 10**9, np.array(poses))


def true_relations(trajectory, pairs):
    first, second = (np.array(column) for column in zip(*pairs, strict=True))
    poses = se2.between(trajectory.poses[first], trajectory.poses[second])
    return Relations(trajectory.stamps_ns[first], trajectory.stamps_ns[second], poses)


PAIRS = [(0, 5), (3, 19), (7, 8), (12, 2)]


def test_truth_has_no_error_in_whatever_frame():
    truth = drive()
    moved = Trajectory(truth.stamps_ns, se2.compose(np.array([5.0, -3.0, 2.0]), truth.poses))
    errors = relation_errors(moved, true_relations(truth, PAIRS))
    assert (errors.relations, errors.unmatched) == (4, 0)
    assert errors.max_m < 1e-9
    assert errors.max_deg < 1e-6


def test_error_is_the_pose_between_true_and_estimated_relation():
    truth = drive()
    relations = true_relations(truth, [(0, 5)])
    off = np.array([0.3, 0.4, np.radians(10.0)])
    poses = truth.poses.copy()
    poses[5] = se2.compose(poses[5], off)
    errors = relation_errors(Trajectory(truth.stamps_ns, poses), relations)
    assert errors.mean_m == pytest.approx(0.5)
    assert errors.mean_deg == pytest.approx(10.0)
    assert errors.mean_squared_m2 == pytest.approx(0.25)


def test_relations_of_less_than_ten_seconds_have_figures_of_their_own():
    truth = drive()
    relations = true_relations(truth, [(0, 5), (5, 7), (3, 13), (0, 19)])
    poses = truth.poses.copy()
    poses[5] = se2.compose(poses[5], np.array([0.3, 0.4, 0.0]))
    poses[19] = se2.compose(poses[19], np.array([3.0, 4.0, 0.0]))
    errors = relation_errors(Trajectory(truth.stamps_ns, poses), relations)
    assert errors.max_m == pytest.approx(5.0)
    assert errors.mean_m == pytest.approx((0.5 + 0.5 + 0.0 + 5.0) / 4)
    assert errors.median_m == pytest.approx(0.5)
    assert (errors.short.relations, errors.short.unmatched) == (2, 0)
    assert errors.short.mean_m == errors.short.max_m == pytest.approx(0.5)
    assert errors.short.short is None
    assert relation_errors(truth, true_relations(truth, [(0, 12)])).short is None


def test_relations_without_a_pose_are_counted():
    truth = drive()
    relations = true_relations(truth, PAIRS)
    errors = relation_errors(Trajectory(truth.stamps_ns[:13], truth.poses[:13]), relations)
    assert (errors.relations, errors.unmatched, errors.unmatched_share) == (3, 1, 0.25)
    with pytest.raises(RelationsError, match="same log"):
        relation_errors(Trajectory(truth.stamps_ns + 1, truth.poses), relations)


def test_file_is_read_with_exact_stamps(tmp_path):
    file = tmp_path / "r"
    file.write_text("# comment\n976052905.167303 976052911.885496 -0.5 0.25 0 0 0 -1.5\n")
    relations = read_relations(file)
    assert relations.first_ns.tolist() == [976_052_905_167_303_000]
    assert relations.poses.tolist() == [[-0.5, 0.25, -1.5]]


@pytest.mark.parametrize("text", ["", "1 2 3\n", "1 2 a b c d e f\n", "# only a comment\n"])
def test_unusable_file_is_refused_in_one_line(text, tmp_path):
    file = tmp_path / "r"
    file.write_text(text)
    with pytest.raises(RelationsError, match=r"^[^\n]*$"):
        read_relations(file)
    with pytest.raises(RelationsError, match="cannot read"):
        read_relations(tmp_path / "missing")
