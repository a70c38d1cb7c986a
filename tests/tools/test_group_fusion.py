"""`fuse` on files: two and more, good and bad, by both methods, and interrupted."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map
from tools.group_fusion import fuse_maps
from tools.pair_registration import Registration

FRAMES = {"west": np.zeros(3), "mid": np.array([4.0, -7.0, 1.1]), "east": np.array([-3.0, 2.0, -2.4])}


@pytest.fixture(scope="module")
def three_maps(tmp_path_factory, rooms_part):
    """Three windows of the floor, each sharing some of it with each other, and where they were fused."""
    folder = tmp_path_factory.mktemp("three")
    for seed, (name, (first, last)) in enumerate({"west": (0, 200), "mid": (50, 290), "east": (110, 320)}.items()):
        write_map(folder / name, rooms_part(seed, first, last, FRAMES[name]))
    return [folder / f"{name}.yaml" for name in FRAMES]


@pytest.fixture(scope="module")
def registered(three_maps, tmp_path_factory):
    """The finished pairs of the three maps, in the file that `fuse` keeps them in."""
    folder, report = fuse_maps(three_maps, tmp_path_factory.mktemp("first"), Registration("default", THESIS, 0))
    assert report["registrations"]["registered"] == 3
    return folder / "pairs.jsonl"


@pytest.fixture
def resumed(registered, tmp_path):
    """A folder in which a run was interrupted just before its end."""
    (tmp_path / "out").mkdir()
    shutil.copy(registered, tmp_path / "out")
    return tmp_path / "out"


def test_fuse_gives_the_same_map_whatever_the_order(cli, two_maps, tmp_path, true_pose):
    for name, files in (("ab", two_maps), ("ba", two_maps[::-1])):
        outcome = cli("fuse", *files, "-o", tmp_path / name)
        assert outcome.code == 0, outcome.err
    one, other = read_map(tmp_path / "ab/global_0.npz"), read_map(tmp_path / "ba/global_0.npz")
    np.testing.assert_array_equal(one.log_odds, other.log_odds)
    np.testing.assert_array_equal(one.origin, other.origin)
    report = json.loads((tmp_path / "ab/report.json").read_text())
    poses = {entry["file"]: np.array(entry["T_global_map"]) for entry in report["maps"]}
    relative = se2.between(*(poses[str(path)] for path in two_maps))
    np.testing.assert_allclose(relative, true_pose, atol=0.05)
    for suffix in ("yaml", "pgm", "png"):
        assert (tmp_path / f"ab/global_0.{suffix}").stat().st_size > 0


def test_the_fused_map_covers_what_either_saw(cli, two_maps, tmp_path, rooms_part):
    cli("fuse", *two_maps, "-o", tmp_path / "out")
    fused = read_map(tmp_path / "out/global_0.npz")
    assert np.count_nonzero(fused.free) == pytest.approx(np.count_nonzero(rooms_part(1).free), rel=0.05)


def test_maps_that_share_nothing_stay_two(cli, tmp_path, rooms_part):
    write_map(tmp_path / "a", rooms_part(1, 0, 140))
    write_map(tmp_path / "b", rooms_part(2, 180, 320, np.array([6.0, -3.0, 2.2])))
    outcome = cli("fuse", tmp_path / "a.yaml", tmp_path / "b.yaml", "-o", tmp_path / "out", "--json")
    assert outcome.code == 3
    assert {entry["group"] for entry in json.loads(outcome.out)["maps"]} == {0, 1}
    assert (tmp_path / "out/global_1.yaml").exists()
    # A later, better result does not leave the second map of the earlier one behind.
    assert cli("fuse", tmp_path / "a.yaml", "-o", tmp_path / "out").code == 0
    assert not (tmp_path / "out/global_1.yaml").exists()


def test_a_map_given_twice_counts_once(cli, two_maps, tmp_path):
    outcome = cli("fuse", two_maps[0], two_maps[0], "-o", tmp_path / "out", "--json")
    assert outcome.code == 0
    assert json.loads(outcome.out)["pairs"][0]["same_evidence"] is True
    np.testing.assert_array_equal(read_map(tmp_path / "out/global_0.npz").log_odds, read_map(two_maps[0]).log_odds)


def test_two_maps_of_nothing_leave_no_global_map(cli, tmp_path):
    for name in ("a", "b"):
        write_map(tmp_path / name, OccupancyGrid(np.zeros((9, 9), np.float32), 0.05, np.zeros(3)))
    outcome = cli("fuse", tmp_path / "a.yaml", tmp_path / "b.yaml", "-o", tmp_path / "out")
    assert outcome.code == 3
    assert "no global maps" in outcome.out
    assert not list((tmp_path / "out").glob("global_*"))


def test_fuse_reports_its_method(cli, two_maps, tmp_path):
    outcome = cli("fuse", *two_maps, "-o", tmp_path / "out", "--method", "thesis", "--detector", "akaze", "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["pairs"]
    assert (report["method"], report["settings"]["features"]) == ("thesis", "akaze+akaze")
    alone = json.loads(cli("fuse", two_maps[0], "-o", tmp_path / "out", "--json").out)
    assert (alone["method"], alone["settings"]) == ("default", None)


def test_three_maps_are_one_at_their_true_poses_and_nothing_is_registered_twice(cli, three_maps, resumed):
    outcome = cli("fuse", *three_maps, "-o", resumed, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["pairs"]
    assert (report["registrations"]["registered"], report["registrations"]["from_cache"]) == (0, 3)
    assert report["registrations"]["all_pairs"] == 3
    poses = {entry["file"]: np.array(entry["T_global_map"]) for entry in report["maps"]}
    for path in three_maps:
        found = se2.between(poses[str(three_maps[0])], poses[str(path)])
        np.testing.assert_allclose(found, se2.inverse(FRAMES[path.stem]), atol=0.06)
    covariances = [np.array(entry["covariance"]) for entry in report["maps"]]
    assert sorted(np.linalg.eigvalsh(each).min() > 0.0 for each in covariances) == [False, True, True]


def test_three_maps_in_any_order_with_copies_and_bad_files_among_them(cli, three_maps, resumed, tmp_path):
    assert cli("fuse", *three_maps, "-o", resumed).code == 0
    expected = read_map(resumed / "global_0.npz")
    (tmp_path / "bad.yaml").write_text("image: none.pgm\n")
    write_map(tmp_path / "blank", OccupancyGrid(np.zeros((9, 9), np.float32), 0.05, np.zeros(3)))
    files = [three_maps[2], tmp_path / "bad.yaml", three_maps[0], three_maps[2], tmp_path / "blank.yaml", three_maps[1]]
    outcome = cli("fuse", *files, "-o", resumed, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 3
    assert report["registrations"]["registered"] == 0
    fused = read_map(resumed / "global_0.npz")
    np.testing.assert_array_equal(fused.log_odds, expected.log_odds)
    np.testing.assert_array_equal(fused.origin, expected.origin)
    entries = report["maps"]
    assert [entry["group"] for entry in entries] == [0, None, 0, 0, None, 0]
    assert "bad.yaml" in entries[1]["skipped"]
    assert "no known cell" in entries[4]["skipped"]
    assert entries[3]["same_as"] == str(three_maps[2])
    assert "bad.yaml" in outcome.err
    assert "skipped" in outcome.err


def test_a_pair_that_contradicts_two_surer_ones_is_withdrawn(cli, three_maps, resumed):
    lines = [json.loads(line) for line in (resumed / "pairs.jsonl").read_text().splitlines()]
    for entry in lines:
        entry["probability"] = 0.9999
    lines[0]["probability"] = 0.96
    lines[0]["T_a_b"][2] += np.pi
    (resumed / "pairs.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in lines))
    outcome = cli("fuse", *three_maps, "-o", resumed, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0
    withdrawn = [pair for pair in report["pairs"] if pair["withdrawn"]]
    assert len(withdrawn) == 1
    assert not withdrawn[0]["accepted"]
    assert "contradicts the way by" in withdrawn[0]["reason"]
    assert str(three_maps[0].parent) in withdrawn[0]["reason"]  # files, not hashes
    assert "withdrawn" in outcome.err
    poses = {entry["file"]: np.array(entry["T_global_map"]) for entry in report["maps"]}
    for path in three_maps:
        found = se2.between(poses[str(three_maps[0])], poses[str(path)])
        np.testing.assert_allclose(found, se2.inverse(FRAMES[path.stem]), atol=0.06)


def test_the_method_of_the_thesis_merges_in_levels(cli, three_maps, tmp_path):
    options = ("--method", "thesis", "--detector", "akaze")
    outcome = cli("fuse", *three_maps, "-o", tmp_path / "out", *options, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["pairs"]
    assert [level["level"] for level in report["levels"]] == [1, 2]
    assert [len(level["merged"]) for level in report["levels"]] == [1, 1]
    merged = report["levels"][1]["merged"][0]
    assert sorted(merged["a"] + merged["b"]) == sorted(map(str, three_maps))
    assert report["trees"][0][0] == "3 maps"
    poses = {entry["file"]: np.array(entry["T_global_map"]) for entry in report["maps"]}
    for path in three_maps:
        found = se2.between(poses[str(three_maps[0])], poses[str(path)])
        np.testing.assert_allclose(found, se2.inverse(FRAMES[path.stem]), atol=0.1)
    again = cli("fuse", *three_maps, "-o", tmp_path / "out", *options)
    assert again.code == 0
    assert "0 pairs registered, 4 taken from an earlier run" in again.out


@pytest.fixture
def folder_of_maps(three_maps, tmp_path):
    """A folder with the three maps, and one where their pairs are finished."""
    shutil.copytree(three_maps[0].parent, tmp_path / "maps")
    for file in (tmp_path / "maps").glob("*.npz"):
        file.unlink()  # the finished pairs are those of the images
    return tmp_path / "maps"


def test_a_folder_stands_for_the_maps_in_it(cli, folder_of_maps, resumed):
    outcome = cli("fuse", folder_of_maps, "-o", resumed, "--jobs", "all", "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["pairs"]
    assert [entry["file"] for entry in report["maps"]] == [
        str(folder_of_maps / f"{name}.yaml") for name in ("east", "mid", "west")
    ]
    assert report["registrations"]["registered"] == 0


def test_bad_maps_in_a_folder_are_named_and_skipped(cli, folder_of_maps, resumed):
    whole = (folder_of_maps / "mid.pgm").read_bytes()
    (folder_of_maps / "half.pgm").write_bytes(whole[: len(whole) // 2])
    (folder_of_maps / "half.yaml").write_text((folder_of_maps / "mid.yaml").read_text().replace("mid.pgm", "half.pgm"))
    (folder_of_maps / "torn.npz").write_bytes(b"PK half")
    (folder_of_maps / "empty.yaml").write_text("")
    outcome = cli("fuse", folder_of_maps, "-o", resumed, "--json")
    assert outcome.code == 3
    skipped = {entry["file"] for entry in json.loads(outcome.out)["maps"] if "skipped" in entry}
    assert skipped == {str(folder_of_maps / name) for name in ("empty.yaml", "half.yaml", "torn.npz")}
    for name in ("half.pgm", "torn.npz", "empty.yaml"):
        assert name in outcome.err


def test_a_folder_of_which_nothing_can_be_read_is_one_line(cli, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.npz").write_bytes(b"PK half")
    outcome = cli("fuse", tmp_path, "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "none of 2 maps can be read" in outcome.err
    assert "Traceback" not in outcome.err


def test_an_empty_folder_is_one_line(cli, tmp_path):
    (tmp_path / "maps").mkdir()
    outcome = cli("fuse", tmp_path / "maps", "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "no map in it" in outcome.err


def test_of_a_folder_with_one_map_a_copy_is_made_and_said(cli, two_maps, tmp_path):
    (tmp_path / "one").mkdir()
    for name in ("a.yaml", "a.pgm"):
        shutil.copy(two_maps[0].parent / name, tmp_path / "one")
    outcome = cli("fuse", tmp_path / "one", "-o", tmp_path / "out")
    assert outcome.code == 0
    assert "this is a copy" in outcome.out
    np.testing.assert_array_equal(read_map(tmp_path / "out/global_0.npz").log_odds, read_map(two_maps[0]).log_odds)


def test_two_maps_of_one_name_are_two_maps(cli, tmp_path):
    for name, width in (("car_a", 40), ("car_b", 50)):
        (tmp_path / "cars" / name).mkdir(parents=True)
        free_space = OccupancyGrid(np.full((40, width), -3.0, np.float32), 0.05, np.zeros(3))
        write_map(tmp_path / "cars" / name / "map", free_space)
        (tmp_path / "cars" / name / "report.json").write_text("{}")
    outcome = cli("fuse", tmp_path / "cars", "-o", tmp_path / "out", "--json")
    assert outcome.code == 3, "free space without a wall is not aligned"
    assert {entry["file"] for entry in json.loads(outcome.out)["maps"]} == {
        str(tmp_path / "cars" / name / "map.npz") for name in ("car_a", "car_b")
    }


def test_results_do_not_go_into_the_folder_that_is_read(cli, folder_of_maps):
    outcome = cli("fuse", folder_of_maps, "-o", folder_of_maps)
    assert outcome.code == 1
    assert "would be replaced" in outcome.err


@pytest.mark.parametrize("jobs", ["-1", "many", "1.5"])
def test_an_odd_number_of_jobs_is_a_usage_error(cli, two_maps, jobs):
    assert cli("fuse", *two_maps, "--jobs", jobs).code == 2
