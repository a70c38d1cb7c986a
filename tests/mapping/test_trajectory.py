from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping import se2
from mapping.errors import TrajectoryError
from mapping.trajectory import Trajectory, read_tum, write_tum

# One nanosecond is the 19th digit of today's time in seconds; float64 has 16.
START_NS = 1_700_000_000_123_456_789


def straight(count: int = 3) -> Trajectory:
    stamps = START_NS + np.arange(count) * 1_000_000_001
    return Trajectory(stamps, np.column_stack([np.arange(count), np.zeros(count), np.zeros(count)]))


@given(
    st.lists(st.integers(-(10**12), 4 * 10**18), min_size=1, max_size=8, unique=True).map(sorted),
    st.integers(0, 2**32),
)
def test_tum_text_gives_back_every_nanosecond_and_pose(stamps: list[int], seed: int) -> None:
    poses = np.random.default_rng(seed).uniform([-1e3, -1e3, -np.pi], [1e3, 1e3, np.pi], (len(stamps), 3))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trajectory.tum"
        write_tum(path, Trajectory(np.array(stamps), poses))
        again = read_tum(path)
    assert again.stamps_ns.tolist() == stamps
    np.testing.assert_allclose(again.poses[:, :2], poses[:, :2], rtol=0.0, atol=1e-9)  # nine digits are written
    np.testing.assert_allclose(se2.wrap_angle(again.poses[:, 2] - poses[:, 2]), 0.0, atol=1e-11)  # twelve digits


def test_tum_line_has_the_eight_fields_in_order(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    write_tum(path, Trajectory(np.array([START_NS]), np.array([[1.5, -2.25, np.pi / 2]])))
    fields = path.read_text(encoding="ascii").split()
    assert fields[0] == "1700000000.123456789"
    assert [float(field) for field in fields[1:]] == pytest.approx([1.5, -2.25, 0, 0, 0, 0.5**0.5, 0.5**0.5])


@pytest.mark.parametrize(
    ("stamp", "expected_ns"),
    [
        ("12", 12_000_000_000),
        ("12.5", 12_500_000_000),
        ("0.000000001", 1),
        (".25", 250_000_000),
        ("-0.5", -500_000_000),
        ("-3.000000001", -3_000_000_001),
        ("1.0000000019", 1_000_000_001),  # what is finer than a nanosecond is cut off
        ("1.5e3", 1_500_000_000_000),
    ],
)
def test_stamps_of_other_writers_are_understood(stamp: str, expected_ns: int, tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(f"# comment\n\n{stamp} 1 2 9 0 0 0 1\n", encoding="ascii")
    trajectory = read_tum(path)
    assert trajectory.stamps_ns.tolist() == [expected_ns]
    assert trajectory.poses.tolist() == [[1.0, 2.0, 0.0]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no pose"),
        ("# only a comment\n", "no pose"),
        ("1 0 0 0 0 0 0 1\n2 0 0\n", ":2: .*3 fields"),
        ("1 0 0 0 0 0 0 1\n2 0 zero 0 0 0 0 1\n", ":2: .*zero"),
        ("soon 0 0 0 0 0 0 1\n", ":1: .*soon"),
        ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "rise"),
        ("1 nan 0 0 0 0 0 1\n", "finite"),
    ],
)
def test_unusable_text_is_refused_in_one_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(text, encoding="ascii")
    with pytest.raises(TrajectoryError, match=words) as caught:
        read_tum(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="cannot read"):
        read_tum(tmp_path / "none.tum")
    (tmp_path / "binary.tum").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(TrajectoryError, match="cannot read"):
        read_tum(tmp_path / "binary.tum")


def test_interpolation_is_linear_and_holds_the_ends() -> None:
    trajectory = straight()
    query = START_NS + np.array([-(10**9), 0, 500_000_000, 1_000_000_001, 10**12])
    # Differences of stamps are exact integers, and their seconds have a relative error of 1e-16.
    np.testing.assert_allclose(
        trajectory.at(query)[:, 0], [0.0, 0.0, 500_000_000 / 1_000_000_001, 1.0, 2.0], rtol=1e-14
    )


def test_interpolation_turns_the_short_way_over_half_a_turn() -> None:
    trajectory = Trajectory(np.array([0, 100]), np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]]))
    middle = trajectory.at(np.array([50]))[0, 2]
    assert abs(se2.wrap_angle(middle - np.pi)) < 1e-12


def test_length_is_the_sum_of_the_steps() -> None:
    corner = Trajectory(np.arange(3), np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 5.0, 1.0]]))
    assert corner.length_m == pytest.approx(6.0)
    assert straight(1).length_m == 0.0
    assert Trajectory(np.zeros(0, np.int64), np.zeros((0, 3))).length_m == 0.0


@pytest.mark.parametrize(
    ("stamps", "poses", "words"),
    [
        ([1, 1], [[0, 0, 0], [0, 0, 0]], "rise strictly"),
        ([2, 1], [[0, 0, 0], [0, 0, 0]], "rise strictly"),
        ([1, 2], [[0, 0, 0]], "expected"),
        ([1], [[0, float("inf"), 0]], "finite"),
    ],
)
def test_impossible_trajectories_are_refused(stamps: list[int], poses: list[list[float]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Trajectory(np.array(stamps), np.array(poses))


def test_arrays_are_copied_and_read_only() -> None:
    stamps, poses = np.array([1, 2]), np.zeros((2, 3))
    trajectory = Trajectory(stamps, poses)
    poses[0, 0] = 5.0
    assert trajectory.poses[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.poses[0, 0] = 1.0
