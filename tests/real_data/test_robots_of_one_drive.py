"""Robots that share a real drive are fused and know where they are (thesis section 5.5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from mapping import se2
from mapping.trajectory import read_tum
from tools.data_set_plan import DataSetPlan
from tools.group_fusion import fuse_maps
from tools.map_data_set import write_data_set
from tools.pair_registration import Registration
from tools.recorded_pairs import Drive
from tools.robot_maps import robot_maps

pytestmark = pytest.mark.real_data


def test_three_robots_of_csail_are_where_the_log_has_them(data_dir, tmp_path):
    (tmp_path / "maps").mkdir()
    log = Drive(data_dir / "carmen_ple/csail-corrected.log.gz")
    of_six = robot_maps([log], DataSetPlan(), tmp_path)
    data = replace(of_six, maps=of_six.maps[:3])
    write_data_set(data)
    _, report = fuse_maps([each.path for each in data.maps], tmp_path / "out", Registration("default", THESIS, 0))
    assert {each["group"] for each in report["maps"]} == {0}
    in_log = [
        se2.compose(each.pose, read_tum(each.trajectory).poses[-1])
        for each in data.maps
        if each.pose is not None and each.trajectory is not None
    ]
    fused = [np.array(each["T_global_robot"]) for each in report["robots"]]
    for here, there in zip(fused, in_log, strict=True):
        off = se2.between(se2.between(in_log[0], there), se2.between(fused[0], here))
        assert np.hypot(*off[:2]) < 0.15
        assert abs(np.degrees(off[2])) < 1.0
