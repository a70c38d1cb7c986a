"""`align` and `fuse` on files, good and bad."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map

POSE = np.array([6.0, -3.0, 2.2])


def rooms(seed: int) -> OccupancyGrid:
    """A floor of 16 m x 12 m with walls and furniture, seen with some noise."""
    image = np.full((240, 320), 255, np.uint8)
    random = np.random.default_rng(3)
    cv2.rectangle(image, (0, 0), (319, 239), 0, 2)
    for x in (90, 150, 260):
        cv2.line(image, (x, 0), (x, 90), 0, 2)
    cv2.line(image, (60, 130), (319, 130), 0, 2)
    cv2.line(image, (130, 130), (145, 130), 255, 3)
    for _ in range(45):
        x, y, width, height = random.integers([5, 5, 4, 4], [310, 230, 20, 20]).tolist()
        cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)
    cells = np.where(image > 0, -5.0, 5.0)
    cells[np.random.default_rng(seed).random(cells.shape) < 0.01] = 0.0
    return OccupancyGrid(cells.astype(np.float32), 0.05, np.zeros(3))


def cut(grid: OccupancyGrid, columns: slice, frame: np.ndarray) -> OccupancyGrid:
    """Some columns of a grid, in a map frame in which the grid's frame has the pose `frame`."""
    corner = np.array([columns.start * grid.resolution_m, 0.0, 0.0])
    return OccupancyGrid(grid.log_odds[:, columns], grid.resolution_m, se2.compose(frame, corner))


@pytest.fixture
def two_maps(tmp_path):
    """YAML files of two halves that share a third of the floor; the second's origin is rotated, as nav2 allows."""
    write_map(tmp_path / "a", cut(rooms(1), slice(0, 220), se2.IDENTITY))
    write_map(tmp_path / "b", cut(rooms(2), slice(90, 320), POSE))
    return tmp_path / "a.yaml", tmp_path / "b.yaml"


def test_align_prints_the_pose_of_b_in_a(cli, two_maps):
    outcome = cli("align", *two_maps, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, outcome.err
    found = np.array([report["dx"], report["dy"], np.radians(report["theta_deg"])])
    np.testing.assert_allclose(found, se2.inverse(POSE), atol=0.05)
    assert report["accepted"] is True
    assert report["probability"] > 0.9
    assert np.linalg.eigvalsh(np.array(report["covariance"])).min() > 0.0
    assert report["common_wall_m"] > 3.0
    assert report["alternatives"] == []
    assert report["ambiguous"] is False
    assert 0.3 < report["overlap"] < 0.7


def test_align_draws_the_verdict(cli, two_maps, tmp_path):
    outcome = cli("align", *two_maps, "-o", tmp_path / "verdict")
    assert outcome.code == 0, outcome.err
    assert "probability" in outcome.out
    assert cv2.imread(str(tmp_path / "verdict/alignment.png")).shape == (1000, 1600, 3)
    assert json.loads((tmp_path / "verdict/alignment.json").read_text())["accepted"] is True


def test_fuse_gives_the_same_map_whatever_the_order(cli, two_maps, tmp_path):
    for name, files in (("ab", two_maps), ("ba", two_maps[::-1])):
        outcome = cli("fuse", *files, "-o", tmp_path / name)
        assert outcome.code == 0, outcome.err
    one, other = read_map(tmp_path / "ab/global_0.npz"), read_map(tmp_path / "ba/global_0.npz")
    np.testing.assert_array_equal(one.log_odds, other.log_odds)
    np.testing.assert_array_equal(one.origin, other.origin)
    report = json.loads((tmp_path / "ab/report.json").read_text())
    poses = {entry["file"]: np.array(entry["T_global_map"]) for entry in report["maps"]}
    relative = se2.between(*(poses[str(path)] for path in two_maps))
    np.testing.assert_allclose(relative, se2.inverse(POSE), atol=0.05)
    for suffix in ("yaml", "pgm", "png"):
        assert (tmp_path / f"ab/global_0.{suffix}").stat().st_size > 0


def test_the_fused_map_covers_what_either_saw(cli, two_maps, tmp_path):
    cli("fuse", *two_maps, "-o", tmp_path / "out")
    fused = read_map(tmp_path / "out/global_0.npz")
    assert np.count_nonzero(fused.free) == pytest.approx(np.count_nonzero(rooms(1).free), rel=0.05)


def test_maps_that_share_nothing_stay_two(cli, tmp_path):
    write_map(tmp_path / "a", cut(rooms(1), slice(0, 140), se2.IDENTITY))
    write_map(tmp_path / "b", cut(rooms(2), slice(180, 320), POSE))
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


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_a_map_without_free_cells_is_refused_not_fatal(cli, two_maps, tmp_path, value):
    write_map(tmp_path / "poor", OccupancyGrid(np.full((9, 9), value, np.float32), 0.05, np.zeros(3)))
    outcome = cli("align", two_maps[0], tmp_path / "poor.yaml", "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 3
    assert (report["accepted"], report["dx"]) == (False, None)
    assert "the second map has no cell that is free" in report["reason"]
    fused = cli("fuse", two_maps[0], tmp_path / "poor.yaml", "-o", tmp_path / "out", "--json")
    assert fused.code == 3
    groups = [entry["group"] for entry in json.loads(fused.out)["maps"]]
    assert groups == ([0, None] if value == 0.0 else [0, 1])


def test_two_maps_of_nothing_leave_no_global_map(cli, tmp_path):
    for name in ("a", "b"):
        write_map(tmp_path / name, OccupancyGrid(np.zeros((9, 9), np.float32), 0.05, np.zeros(3)))
    outcome = cli("fuse", tmp_path / "a.yaml", tmp_path / "b.yaml", "-o", tmp_path / "out")
    assert outcome.code == 3
    assert "no global maps" in outcome.out
    assert not list((tmp_path / "out").glob("global_*"))


def test_maps_of_one_cell_are_refused(cli, tmp_path):
    for name in ("a", "b"):
        write_map(tmp_path / name, OccupancyGrid(np.full((1, 1), -3.0, np.float32), 0.05, np.zeros(3)))
    outcome = cli("align", tmp_path / "a.yaml", tmp_path / "b.yaml")
    assert outcome.code == 3
    assert outcome.out.startswith("refused: ")


def test_a_negated_map_of_another_robot_is_read_as_meant(cli, two_maps, tmp_path):
    text = two_maps[1].read_text()
    image = cv2.imread(str(tmp_path / "b.pgm"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(tmp_path / "negative.pgm"), 255 - image)
    (tmp_path / "negative.yaml").write_text(text.replace("b.pgm", "negative.pgm").replace("negate: 0", "negate: 1"))
    outcome = cli("align", two_maps[0], tmp_path / "negative.yaml", "--json")
    assert outcome.code == 0, outcome.out
    assert json.loads(outcome.out)["theta_deg"] == pytest.approx(np.degrees(se2.inverse(POSE)[2]), abs=1.0)


def test_bad_files_fail_with_one_line(cli, two_maps, tmp_path):
    for arguments in (
        ("align", tmp_path / "none.yaml", two_maps[0]),
        ("fuse", tmp_path / "none.yaml", tmp_path / "a.pgm", "-o", tmp_path / "out"),
    ):
        outcome = cli(*arguments)
        assert outcome.code == 1
        assert len(outcome.error_lines) == 1


THESIS_OPTIONS = {
    "as in the thesis": (),
    "detector": ("--detector", "akaze", "--descriptor", "sift", "--ratio", "0.7", "--trials", "2000"),
    "alpha auto": ("--alpha", "auto", "--detector", "orb"),
    "scale": ("--scale", "estimate", "--tolerance-px", "2", "--confidence", "0.999"),
    "fine": ("--common-cell", "fine", "--alpha", "0.5"),
}


@pytest.mark.parametrize("options", THESIS_OPTIONS.values(), ids=THESIS_OPTIONS)
def test_the_method_of_the_thesis_and_its_options(cli, two_maps, options):
    outcome = cli("align", *two_maps, "--method", "thesis", *options, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["reason"]
    assert report["method"] == "thesis"
    found = np.array([report["dx"], report["dy"], np.radians(report["theta_deg"])])
    np.testing.assert_allclose(found, se2.inverse(POSE), atol=0.1)
    assert report["scale"] == (pytest.approx(1.0, abs=0.01) if "estimate" in options else None)
    alpha = options[options.index("--alpha") + 1] if "--alpha" in options else "0.99"
    assert str(report["settings"]["alpha"]) == alpha
    assert ("chosen from" in report["reason"]) == ("auto" in options)


def test_fuse_reports_its_method(cli, two_maps, tmp_path):
    outcome = cli("fuse", *two_maps, "-o", tmp_path / "out", "--method", "thesis", "--detector", "akaze", "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["pairs"]
    assert (report["method"], report["settings"]["features"]) == ("thesis", "akaze+akaze")
    alone = json.loads(cli("fuse", two_maps[0], "-o", tmp_path / "out", "--json").out)
    assert (alone["method"], alone["settings"]) == ("default", None)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--alpha", "0.5", "--common-cell", "fine"), "--alpha, --common-cell: only with --method thesis"),
        (("--method", "thesis", "--detector", "surf"), "detector surf: it is not in OpenCV's wheels"),
        (("--method", "thesis", "--descriptor", "kaze", "--detector", "orb"), "describes keypoints of kaze only"),
        (("--method", "thesis", "--alpha", "much"), "--alpha much: must be a number"),
        (("--method", "thesis", "--alpha", "1"), "alpha 1: must be 0.01 to 0.99"),
        (("--method", "thesis", "--ratio", "nan"), "ratio nan: must be above 0"),
    ],
)
@pytest.mark.parametrize("command", ["align", "fuse"])
def test_options_that_cannot_be_end_with_one_line_and_exit_code_2(cli, tmp_path, command, options, says):
    outcome = cli(command, tmp_path / "a.yaml", tmp_path / "b.yaml", *options)
    assert outcome.code == 2
    assert len(outcome.error_lines) == 1
    assert says in outcome.error_lines[0]
