"""The comparison of features on two maps, and its command."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fusion.algorithm3 import THESIS, register_by_features
from fusion.features import FeatureMethod
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.feature_study import study_features

KINDS = [FeatureMethod("akaze"), FeatureMethod("orb"), FeatureMethod("harris", "brisk")]


def floor(seed: int) -> OccupancyGrid:
    """Boxes on 10 m x 8 m; p(free) of the cells spreads from 0.5 to 0.99."""
    image = np.full((160, 200), 255, np.uint8)
    random = np.random.default_rng(5)
    for x, y, width, height in random.integers([5, 5, 4, 4], [190, 150, 24, 24], (40, 4)).tolist():
        cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)
    strength = np.random.default_rng(seed).uniform(3.0, 5.5, image.shape)
    return OccupancyGrid(np.where(image > 0, -strength, strength).astype(np.float32), 0.05, np.zeros(3))


@pytest.fixture(scope="module")
def trials():
    return study_features(floor(1), floor(2), THESIS, (KINDS, (0.0, 0.5, 0.99)), 0, lambda _: None)


def test_there_is_a_row_for_every_choice(trials):
    assert [(trial.features, trial.alpha) for trial in trials] == [
        (kind.name, alpha) for kind in KINDS for alpha in (0.0, 0.5, 0.99)
    ]
    for trial in trials:
        assert 0 <= trial.inliers <= trial.matches <= min(trial.keypoints_a, trial.keypoints_b)
        assert trial.precision == (pytest.approx(trial.inliers / trial.matches, abs=1e-4) if trial.matches else None)


def test_a_row_counts_what_the_registration_finds(trials):
    for trial in trials:
        kind = next(kind for kind in KINDS if kind.name == trial.features)
        found = register_by_features(floor(1), floor(2), replace(THESIS, features=kind, alpha=trial.alpha))
        back = register_by_features(floor(2), floor(1), replace(THESIS, features=kind, alpha=trial.alpha))
        assert trial.inliers in {found.inliers or 0, back.inliers or 0}


def test_an_alpha_that_leaves_nothing_is_a_row_of_zeros():
    faint = OccupancyGrid(np.clip(floor(1).log_odds, -2.0, 2.0), 0.05, np.zeros(3))
    (row,) = study_features(floor(1), faint, THESIS, (KINDS[:1], (0.99,)), 0, lambda _: None)
    assert (row.keypoints_b, row.matches, row.inliers, row.precision, row.acceptance) == (0, 0, 0, None, 0.0)


@pytest.fixture
def files(tmp_path):
    for name, seed in (("a", 1), ("b", 2)):
        write_map(tmp_path / name, floor(seed))
    return tmp_path / "a.npz", tmp_path / "b.npz"


def test_the_command_prints_a_table_and_writes_the_figure(cli, files, tmp_path):
    choice = ("--features", "orb,harris+brisk", "--alphas", "0.9,0.5")
    outcome = cli("evaluate", "features", *files, *choice, "-o", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    assert len(outcome.out.splitlines()) == 1 + 4
    rows = json.loads((tmp_path / "out/report.json").read_text())["rows"]
    assert [(row["features"], row["alpha"]) for row in rows[:2]] == [("orb+orb", 0.5), ("orb+orb", 0.9)]
    assert cv2.imread(str(tmp_path / "out/inliers.png")) is not None
    as_json = json.loads(cli("evaluate", "features", *files, *choice, "--json").out)
    assert [row["inliers"] for row in as_json["rows"]] == [row["inliers"] for row in rows]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--features", "surf"), "not in OpenCV's wheels"),
        (("--features", "orb+kaze"), "describes keypoints of kaze only"),
        (("--alphas", "0.5,x"), "could not convert"),
        (("--alphas", "0.5,1"), "alpha 1: must be"),
    ],
)
def test_what_cannot_be_studied_ends_with_one_line(cli, files, options, says):
    outcome = cli("evaluate", "features", *files, *options)
    assert outcome.code == 2
    assert len(outcome.error_lines) == 1
    assert says in outcome.error_lines[0]
