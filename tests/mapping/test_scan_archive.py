from __future__ import annotations

import numpy as np
import pytest

from mapping.scan_archive import ScanArchive

POINTS = 100
BYTES = 8 * POINTS  # of one scan, single precision


def filled(scans: int, most_bytes: int, keyframe_every: int = 10) -> ScanArchive:
    archive = ScanArchive(most_bytes)
    for number in range(scans):
        archive.add(
            1000 * number,
            number // keyframe_every,
            np.array([number, 0.5, -0.25]),
            np.full((POINTS, 2), number, dtype=np.float64),
            matched=number % 3 != 0,
            known=number % 2 == 0,
            is_keyframe=number % keyframe_every == 0,
        )
    return archive


def kept_of(archive: ScanArchive) -> list[int]:
    return [number for number in range(len(archive)) if archive[number].points is not None]


def test_scans_come_back_as_they_were() -> None:
    archive = filled(25, 10**9)
    assert len(archive) == 25
    for number in range(25):
        scan = archive[number]
        assert (scan.stamp_ns, scan.keyframe) == (1000 * number, number // 10)
        assert (scan.matched, scan.known, scan.is_keyframe) == (number % 3 != 0, number % 2 == 0, number % 10 == 0)
        np.testing.assert_array_equal(scan.T_keyframe_scan, [number, 0.5, -0.25])
        np.testing.assert_array_equal(scan.points, np.full((POINTS, 2), number))
    stamps, keyframes, poses = archive.table()
    assert stamps.tolist() == [1000 * number for number in range(25)]
    assert keyframes.tolist() == [number // 10 for number in range(25)]
    np.testing.assert_array_equal(poses[:, 0], np.arange(25))


def test_an_empty_archive_has_an_empty_table() -> None:
    stamps, keyframes, poses = ScanArchive(100).table()
    assert (stamps.shape, keyframes.shape, poses.shape) == ((0,), (0,), (0, 3))


@pytest.mark.parametrize("scans", [101, 150, 400, 999, 3000])
def test_memory_is_kept_and_thinned_evenly(scans: int) -> None:
    most = 400 if scans > 1000 else 100
    archive = filled(scans, most * BYTES)
    kept = kept_of(archive)
    assert len(kept) <= most
    assert set(range(0, scans, 10)) <= set(kept)  # the keyframes
    loose = np.array([number for number in kept if number % 10])
    if len(loose):
        gaps = np.diff(loose)
        # Every n-th of the scans that are no keyframes is left, from the first to the last.
        nth = np.diff([number - 1 - number // 10 for number in loose])
        assert len(set(nth.tolist())) == 1
        assert max(loose[0], scans - loose[-1]) <= 2 * gaps.max()
        assert len(kept) > 0.4 * most
    assert len(archive.table()[0]) == scans


def test_keyframes_alone_may_exceed_the_memory() -> None:
    archive = filled(300, 20 * BYTES, keyframe_every=2)
    assert kept_of(archive) == list(range(0, 300, 2))


def test_the_last_scans_are_forgotten_and_their_memory_is_free_again() -> None:
    archive = filled(40, 40 * BYTES)
    archive.remove_last(3)
    assert len(archive) == 37
    assert archive.table()[0][-1] == 36_000
    for number in range(37, 40):
        archive.add(1000 * number, 3, np.zeros(3), np.zeros((POINTS, 2)), matched=True, known=True, is_keyframe=False)
    assert kept_of(archive) == list(range(40))
    archive.add(40_000, 4, np.zeros(3), np.zeros((POINTS, 2)), matched=True, known=True, is_keyframe=False)
    assert len(kept_of(archive)) < 40


def test_forgetting_no_scan_forgets_none() -> None:
    archive = filled(5, 10**9)
    archive.remove_last(0)
    assert len(archive) == 5


def test_a_scan_can_be_put_elsewhere() -> None:
    archive = filled(5, 10**9)
    archive.move(3, np.array([9.0, 8.0, 0.7]))
    np.testing.assert_array_equal(archive[3].T_keyframe_scan, [9.0, 8.0, 0.7])
    np.testing.assert_array_equal(archive.table()[2][3], [9.0, 8.0, 0.7])
    np.testing.assert_array_equal(archive[2].T_keyframe_scan, [2.0, 0.5, -0.25])


def test_what_the_archive_holds_does_not_change_with_what_was_given() -> None:
    archive, points, pose = ScanArchive(10**9), np.ones((4, 2)), np.ones(3)
    archive.add(1, 0, pose, points, matched=True, known=True, is_keyframe=True)
    points[:] = pose[:] = 7.0
    np.testing.assert_array_equal(archive[0].points, np.ones((4, 2)))
    np.testing.assert_array_equal(archive[0].T_keyframe_scan, np.ones(3))
