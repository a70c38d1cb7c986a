from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_lossless
from mapping.reference_map import reference_map
from mapping.sensor_models import LidarModel
from mapping.trajectory import read_tum
from tools.config import Config
from tools.driven_log import DrivenLog, odometry_from, read_driven_log
from tools.errors import ToolError
from tools.relocalisation_evaluation import (
    Kidnapping,
    MapPart,
    evaluate_relocalisation,
    map_of_part,
    possible_starts,
)

SHORT = Kidnapping(starts=3, drive_m=1.5, track_m=0.5)


@pytest.fixture(scope="module")
def log(project_root) -> DrivenLog:
    stem = project_root / "recordings" / "simulated_office_a2m8"
    return read_driven_log(stem.with_suffix(".mcap"), stem.with_suffix(".golden.tum"), Config())


@pytest.fixture
def run(cli, project_root):
    """Run the command on the recording."""
    stem = project_root / "recordings" / "simulated_office_a2m8"
    return partial(cli, "-q", "evaluate", "relocalisation", f"{stem}.mcap", f"{stem}.golden.tum")


def test_every_scan_has_the_pose_of_its_stamp(log, project_root):
    track = read_tum(project_root / "recordings" / "simulated_office_a2m8.golden.tum")
    assert len(log.stamps_ns) == len(log.points) > 100
    assert np.isin(log.stamps_ns, track.stamps_ns).all()
    np.testing.assert_allclose(log.poses, track.at(log.stamps_ns), atol=1e-9)
    assert log.travelled_m[-1] == pytest.approx(track.length_m, rel=0.05)


def test_a_trajectory_of_another_log_is_refused(project_root, tmp_path):
    other = tmp_path / "other.tum"
    other.write_text("".join(f"{1.0 + n * 0.1:.3f} 0 0 0 0 0 0 1\n" for n in range(5)), encoding="ascii")
    with pytest.raises(ToolError, match="give the trajectory of this log"):
        read_driven_log(project_root / "recordings" / "simulated_office_a2m8.mcap", other, Config())


def test_odometry_begins_afresh_and_follows_the_drive(log):
    start = 60
    numbers, poses = zip(*(pair for pair, _ in zip(odometry_from(log, start), range(40), strict=False)), strict=True)
    assert numbers == tuple(range(start, start + 40))
    np.testing.assert_array_equal(poses[0], np.zeros(3))
    true = np.hypot(*(log.poses[start + 39] - log.poses[start])[:2])
    assert np.hypot(*poses[-1][:2]) == pytest.approx(true, abs=0.1)


def test_no_start_lies_in_the_scans_of_the_map(log):
    middle = len(log.stamps_ns) // 2
    assert possible_starts(log, MapPart.first_half, None, 1.0).min() >= middle
    second = possible_starts(log, MapPart.second_half, None, 1.0)
    assert second.max() < middle
    assert log.travelled_m[second.max()] + 1.0 <= log.travelled_m[middle - 1]


def test_starts_that_the_map_does_not_know_are_left_out(log):
    nowhere = OccupancyGrid(np.full((20, 20), -3.0, np.float32), 0.05, np.array([500.0, 0.0, 0.0]))
    assert len(possible_starts(log, MapPart.first_half, reference_map(nowhere), 1.0)) == 0
    with pytest.raises(ToolError, match="lie in what its map knows"):
        evaluate_relocalisation(log, MapPart.first_half, nowhere, SHORT, foreign=False, on_progress=lambda _: None)


def test_kidnapped_robots_are_found_the_same_way_each_time(log):
    grid = map_of_part(log, MapPart.first_half, 0.05, LidarModel())
    reports = [
        evaluate_relocalisation(log, MapPart.first_half, grid, SHORT, foreign=False, on_progress=lambda _: None)
        for _ in range(2)
    ]
    for report in reports:
        assert report["starts"] == 3
        assert report["wrong"] == 0
        assert report["found"] >= 2
        for row in report["rows"]:
            row.pop("slowest_search_cpu_s")
    assert reports[0]["rows"] == reports[1]["rows"]


def test_the_command_counts_a_place_on_a_foreign_map_as_wrong(log, run, tmp_path):
    own = tmp_path / "claimed_foreign.npz"
    write_lossless(own, map_of_part(log, MapPart.first_half, 0.05, LidarModel()))
    done = run("--starts", "2", "--drive", "1.5", "--foreign-map", own, "--json")
    report = json.loads(done.out)
    assert report["foreign_map"] is True
    assert report["wrong"] >= 1
    assert done.code == 1


def test_an_unknown_part_is_a_usage_error(run):
    done = run("--map-part", "third")
    assert done.code == 2
    assert "expected first-half or second-half" in done.err
