"""`align` on files, good and bad, and the options that `fuse` has as well."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map


def test_align_prints_the_pose_of_b_in_a(cli, two_maps, true_pose):
    outcome = cli("align", *two_maps, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, outcome.err
    found = np.array([report["dx"], report["dy"], np.radians(report["theta_deg"])])
    np.testing.assert_allclose(found, true_pose, atol=0.05)
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


def test_maps_of_one_cell_are_refused(cli, tmp_path):
    for name in ("a", "b"):
        write_map(tmp_path / name, OccupancyGrid(np.full((1, 1), -3.0, np.float32), 0.05, np.zeros(3)))
    outcome = cli("align", tmp_path / "a.yaml", tmp_path / "b.yaml")
    assert outcome.code == 3
    assert outcome.out.startswith("refused: ")


def test_a_negated_map_of_another_robot_is_read_as_meant(cli, two_maps, tmp_path, true_pose):
    text = two_maps[1].read_text()
    image = cv2.imread(str(tmp_path / "b.pgm"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(tmp_path / "negative.pgm"), 255 - image)
    (tmp_path / "negative.yaml").write_text(text.replace("b.pgm", "negative.pgm").replace("negate: 0", "negate: 1"))
    outcome = cli("align", two_maps[0], tmp_path / "negative.yaml", "--json")
    assert outcome.code == 0, outcome.out
    assert json.loads(outcome.out)["theta_deg"] == pytest.approx(np.degrees(true_pose[2]), abs=1.0)


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
def test_the_method_of_the_thesis_and_its_options(cli, two_maps, options, true_pose):
    outcome = cli("align", *two_maps, "--method", "thesis", *options, "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0, report["reason"]
    assert report["method"] == "thesis"
    found = np.array([report["dx"], report["dy"], np.radians(report["theta_deg"])])
    np.testing.assert_allclose(found, true_pose, atol=0.1)
    assert report["scale"] == (pytest.approx(1.0, abs=0.01) if "estimate" in options else None)
    alpha = options[options.index("--alpha") + 1] if "--alpha" in options else "0.99"
    assert str(report["settings"]["alpha"]) == alpha
    assert ("chosen from" in report["reason"]) == ("auto" in options)


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
