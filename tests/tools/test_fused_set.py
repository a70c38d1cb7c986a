"""A fused set, scored: by the truth, by the bends of the maps, or not at all."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from tools.fused_set import FusedSet, fuse_set, is_several


@pytest.fixture(scope="module")
def out(rooms_pairs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fused")
    shutil.copy(rooms_pairs, folder)
    return folder


def worst_m(fused: FusedSet) -> float:
    worst = fused.worst()
    assert worst is not None
    return worst[0]


def moved(data, by):
    """The set with the truth of its last map moved."""
    last = data.maps[-1]
    return replace(data, maps=(*data.maps[:-1], replace(last, pose=last.pose + np.array([by, 0.0, 0.0]))))


def test_maps_are_right_wrong_or_bent_by_how_far_they_are_from_the_truth(rooms_set, out):
    near = fuse_set(rooms_set, "default", 0, 1, out)
    assert near.group_sizes == [3]
    assert worst_m(near) < 0.1
    far = fuse_set(moved(rooms_set, 0.8), "default", 0, 1, out)
    assert worst_m(far) == pytest.approx(0.8, abs=0.1)
    assert False in [each.right for each in far.maps]
    bent = moved(rooms_set, 0.8)
    bent = replace(bent, maps=tuple(replace(each, warp_m=0.3) for each in bent.maps))
    assert all(each.right for each in fuse_set(bent, "default", 0, 1, out).maps)


def test_without_a_truth_there_is_no_error(rooms_set, out):
    unknown = replace(rooms_set, maps=tuple(replace(each, pose=None) for each in rooms_set.maps))
    fused = fuse_set(unknown, "default", 0, 1, out)
    assert fused.worst() is None
    assert [each.right for each in fused.maps] == [None, None, None]


def test_maps_that_were_not_merged_have_no_worst(rooms_set, out):
    fused = fuse_set(rooms_set, "default", 0, 1, out)
    apart = [replace(each, group=number) for number, each in enumerate(fused.maps)]
    alone = FusedSet(fused.folder, fused.report, apart)
    assert (alone.group_sizes, alone.worst()) == ([1, 1, 1], None)


def test_several_robots_are_three_maps_of_as_many(rooms_set):
    assert is_several(rooms_set)
    assert not is_several(replace(rooms_set, maps=rooms_set.maps[:2]))
    assert not is_several(replace(rooms_set, maps=tuple(replace(each, robot="a") for each in rooms_set.maps)))
    assert is_several(replace(rooms_set, maps=tuple(replace(each, robot="") for each in rooms_set.maps)))
