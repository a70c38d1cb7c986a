from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.errors import MappingError
from mapping.ground_truth import read_truth
from mapping.relations import Relations
from mapping.trajectory import Trajectory, read_tum, write_tum

FINITE = st.floats(-100.0, 100.0)
TURNS = st.floats(-3.1, 3.1).filter(lambda yaw: abs(abs(yaw) - 1.0) > 0.05)  # 1 rad looks like a unit quaternion


@given(poses=st.lists(st.tuples(FINITE, FINITE, st.floats(-3.1, 3.1)), min_size=1, max_size=5))
def test_trajectory_is_told_by_its_quaternions(poses, tmp_path_factory):
    path = tmp_path_factory.mktemp("t") / "truth"
    write_tum(path, Trajectory(np.arange(len(poses)) * 10**9, np.array(poses)))
    truth = read_truth(path)
    assert isinstance(truth, Trajectory)
    assert np.array_equal(truth.poses, read_tum(path).poses)


def test_rounded_quaternions_and_a_comment_are_enough(tmp_path):
    path = tmp_path / "truth"
    path.write_text("# t x y z qx qy qz qw\n1.0 2 3 0 0 0 0.71 0.70\n2.0 2 3 0 0 0 0.707 0.707\n")
    assert isinstance(read_truth(path), Trajectory)


@given(poses=st.lists(st.tuples(FINITE, FINITE, TURNS), min_size=20, max_size=20))
def test_relations_are_told_by_their_angles(poses, tmp_path_factory):
    path = tmp_path_factory.mktemp("t") / "truth"
    lines = [f"9760{n}.25 9761{n}.5 {x!r} {y!r} 0 0 0 {yaw!r}\n" for n, (x, y, yaw) in enumerate(poses)]
    path.write_text("".join(lines))
    truth = read_truth(path)
    assert isinstance(truth, Relations)
    assert len(truth) == 20


@pytest.mark.parametrize(
    "content", [b"", b"# nothing\n", b"1 2 3\n", b"hello, world\n", b"\xff\xfe\x00", b"a b c d e f g h\n"]
)
def test_what_is_neither_is_refused_in_one_line(content, tmp_path):
    path = tmp_path / "truth"
    path.write_bytes(content)
    with pytest.raises(MappingError, match=r"^[^\n]*truth[^\n]*$"):
        read_truth(path)
    with pytest.raises(MappingError, match="cannot read"):
        read_truth(tmp_path / "missing")


def test_line_that_breaks_later_on_is_named(tmp_path):
    path = tmp_path / "truth"
    path.write_text("1.0 2 3 0 0 0 0 1\n" * 1 + "2.0 2 3 0 0 0 0\n")
    with pytest.raises(MappingError, match="truth:2"):
        read_truth(path)
