"""What chapter 4 of the thesis says in words, on a map of a real log."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.features import count_keypoints
from fusion.occupancy_image import occupancy_image, turn_nearest
from mapping import se2
from tools.log_windows import map_of
from tools.matched_images import METHODS, agreement, image_of, putative_matches, timed_features
from tools.recorded_pairs import Drive, read_drive

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def grids(data_dir):
    """Of all scans, and of every second one."""
    scans = read_drive(Drive(data_dir / "carmen_ple/freiburg-101-corrected.log.gz"), thin=False)
    assert scans.duration_s == pytest.approx(919.0, abs=1.0)
    return [map_of(scans, np.arange(0, len(scans.poses), k), 0.125, se2.IDENTITY) for k in (1, 2)]


def test_orb_finds_the_most_keypoints_and_sift_the_fewest(grids):
    image = occupancy_image(grids[0])
    counts = {each: count_keypoints(image, each) for each in ("brisk", "harris", "shi-tomasi", "kaze", "orb", "sift")}
    assert max(counts, key=counts.__getitem__) == "orb"
    assert min(counts, key=counts.__getitem__) == "sift"


def test_kaze_matches_a_turned_map_of_fewer_scans_with_most_inliers(grids):
    images = image_of(grids[0], 0.5), turn_nearest(image_of(grids[1], 0.5), 0.6)
    inliers = []
    for method in METHODS:
        fixed, moving = (timed_features(each, method).features for each in images)
        match = agreement(putative_matches(fixed, moving), 0, similarity=False)
        inliers.append(match.inliers)
        assert match.turn_rad == pytest.approx(-0.6, abs=0.01)
    kaze, orb, sift = inliers
    assert kaze > 1.5 * max(orb, sift)
