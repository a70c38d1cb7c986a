"""One drive at several resolutions and rates, and the command that makes the set."""

from __future__ import annotations

import pytest

from mapping.map_io import read_map
from tools.data_set_plan import DataSetPlan
from tools.heterogeneous_maps import heterogeneous_maps
from tools.heterogeneous_set import heterogeneous_set, lacks_rates, lacks_resolutions
from tools.map_data_set import read_data_set, write_data_set
from tools.recorded_pairs import Drive

CHOICE = ("--cells-per-meter", "8,20", "--scan-every", "2,1")


@pytest.fixture(scope="module")
def folder(corridor_log, tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    (folder / "maps").mkdir()
    write_data_set(heterogeneous_maps([Drive(corridor_log)], DataSetPlan((8.0, 20.0), (1, 2)), folder))
    return folder


def test_there_is_a_map_for_each_resolution_and_rate_in_one_frame(folder):
    data = read_data_set(folder)
    assert [each.name for each in data.maps] == ["r8-k1", "r20-k1", "r8-k2", "r20-k2"]
    assert all(each.pose is not None and not each.pose.any() for each in data.maps)
    assert data.maps[0].rate_hz is None  # all stamps of the log are one
    coarse, fine, _, sparse = (read_map(each.path) for each in data.maps)
    assert (coarse.resolution_m, fine.resolution_m) == pytest.approx((0.125, 0.05))
    for a, b in zip(coarse.origin[:2], fine.origin[:2], strict=True):
        assert abs(a - b) <= 0.125
    assert abs(fine.probability - 0.5).sum() > abs(sparse.probability - 0.5).sum()


def test_maps_are_found_by_rate_and_resolution(folder):
    data = read_data_set(folder)
    found = heterogeneous_set(data)
    assert (found.every, found.resolutions) == ((1, 2), (8.0, 20.0))
    assert [each.name for each in found.of_rate(2)] == ["r8-k2", "r20-k2"]
    assert [each.name for each in found.of_resolution(20.0)] == ["r20-k1", "r20-k2"]
    assert found.rate_name(2) == "one scan in 2"
    assert lacks_resolutions(data) is None
    assert lacks_rates(data) is None


def test_a_plain_folder_lacks_what_chapter_4_needs(folder):
    data = read_data_set(folder / "maps")
    for lacking in (lacks_resolutions(data), lacks_rates(data)):
        assert lacking is not None
        assert "heterogeneous" in lacking


def test_the_command_makes_the_same_maps_and_says_what_they_are(cli, corridor_log, folder, tmp_path):
    outcome = cli("data-set", corridor_log, "-o", tmp_path / "out", *CHOICE)
    assert outcome.code == 0, outcome.err
    assert "4 maps" in outcome.out
    made = read_data_set(tmp_path / "out")
    assert made.kind == "heterogeneous"
    assert made.command == (
        "mapfuse-robot data-set hall-corrected.log -o out --kind heterogeneous --cells-per-meter 8,20 "
        "--scan-every 2,1 --seed 0"
    )
    assert "Real data: hall-corrected.log" in made.source
    for each, other in zip(made.maps, read_data_set(folder).maps, strict=True):
        assert (read_map(each.path).log_odds == read_map(other.path).log_odds).all()


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--kind", "sonar"), 2, "heterogeneous"),
        (("--scan-every", "1,0"), 2, "--scan-every"),
        (("--scan-every", "100"), 1, "too few"),
        (("--trajectory", "a", "--trajectory", "b"), 2, "--trajectory"),
    ],
)
def test_what_cannot_be_made_is_one_line_and_leaves_nothing(cli, corridor_log, tmp_path, options, code, says):
    outcome = cli("data-set", corridor_log, "-o", tmp_path / "out", *options)
    assert (outcome.code, len(outcome.error_lines)) == (code, 1), outcome.err
    assert says in outcome.error_lines[0]
    assert list(tmp_path.iterdir()) == []


def test_two_logs_are_no_one_environment(cli, corridor_log, tmp_path):
    outcome = cli("data-set", corridor_log, corridor_log, "-o", tmp_path / "out")
    assert outcome.code == 2
    assert "takes 1 LOG, not 2" in outcome.error_lines[0]
