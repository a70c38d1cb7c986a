"""A drive cut into the parts of several robots."""

from __future__ import annotations

import itertools

import pytest

from mapping.trajectory import read_tum
from tools.map_data_set import read_data_set


@pytest.fixture(scope="module")
def made(corridor_log, tmp_path_factory):
    """Four robots' maps."""
    from tools.data_set_plan import DataSetPlan
    from tools.recorded_pairs import Drive
    from tools.robot_maps import robot_maps

    folder = tmp_path_factory.mktemp("robots")
    (folder / "maps").mkdir()
    return robot_maps([Drive(corridor_log)], DataSetPlan(robots=4, cells_per_meter=(10.0, 20.0)), folder)


def test_each_robot_has_its_resolution_and_its_rate(made):
    assert [each.robot for each in made.maps] == ["robot1", "robot2", "robot3", "robot4"]
    assert [each.cells_per_meter for each in made.maps] == pytest.approx([10.0, 20.0, 10.0, 20.0])
    assert [each.scan_every for each in made.maps] == [2, 4, 2, 6]
    assert len({tuple(each.pose) for each in made.maps}) == 4


def test_neighbours_share_half_of_the_way_and_no_scan(made):
    # The log's stamps are all one, so a stamp in a trajectory is the number of the scan.
    numbers = [read_tum(each.trajectory).stamps_ns // 10**9 for each in made.maps]
    assert len({*numbers[0]} & {*numbers[1]}) == 0
    assert len(numbers[0]) == pytest.approx(2 * len(numbers[1]), abs=1)
    for one, other in itertools.pairwise(numbers):
        shared = min(one[-1], other[-1]) - max(one[0], other[0])
        assert shared / (one[-1] - one[0]) == pytest.approx(0.5, abs=0.12)
    assert len({number for each in numbers for number in each}) == sum(map(len, numbers))


def test_the_command_makes_them_and_says_how(cli, corridor_log, tmp_path):
    options = ("--kind", "robots", "--robots", "3", "--cells-per-meter", "10")
    outcome = cli("data-set", corridor_log, "-o", tmp_path / "out", *options)
    assert outcome.code == 0, outcome.err
    data = read_data_set(tmp_path / "out")
    assert data.command.endswith("--kind robots --cells-per-meter 10 --robots 3 --seed 0")
    assert "3 parts of 2/4 of the way" in data.source
    assert all(each.trajectory.is_file() for each in data.maps)


@pytest.mark.parametrize(("options", "says"), [(("--scan-every", "3"), "even"), (("--robots", "50"), "needed")])
def test_what_cannot_be_cut_is_one_line(cli, corridor_log, tmp_path, options, says):
    outcome = cli("data-set", corridor_log, "-o", tmp_path / "out", "--kind", "robots", *options)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert says in outcome.error_lines[0]
    assert list(tmp_path.iterdir()) == []
