"""Experiment 5.4 from finished rows: which rule merges when, rightly or wrongly; and what it needs."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_lossless
from tools.experiment import ExperimentSettings
from tools.experiment_growing import lacks, run
from tools.finished_rows import FinishedRows
from tools.growing_steps import WAYS
from tools.map_data_set import DataSetMap, MapDataSet

STEPS = 12
GRID = OccupancyGrid(np.full((4, 4), -1.0, np.float32), 0.05, np.zeros(3))
POSES = {"a": np.array([1.0, 0.0, 0.3]), "b": np.array([-2.0, 4.0, -1.0])}
TRUE = se2.between(POSES["a"], POSES["b"])
POINTS = [[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]]


@pytest.fixture
def data(tmp_path):
    write_lossless(tmp_path / "map.npz", GRID)
    maps = [
        DataSetMap(f"{robot}-{step}", tmp_path / "map.npz", 0.05, robot=robot, step=step, pose=POSES[robot])
        for robot in "ab"
        for step in range(1, STEPS + 1)
    ]
    return MapDataSet(tmp_path, "made-up", "Made up.", True, tuple(maps), "growing")


def finished(folder, *, places=True):
    """Rows of 12 steps: a wrong place until the sixth, at which the verdict jumps to the right one."""
    rows = FinishedRows(folder / "steps.jsonl", "seed 0")
    for step in range(1, STEPS + 1):
        common_m = 10.0 * max(0, step - 4) if places else 0.0
        rows.add(
            f"{step} truth",
            {
                "points_b": POINTS,
                "common_free_m2": common_m,
                "common_wall_m": common_m,
                "error_points_b": POINTS if places else None,
            },
        )
        right = places and step >= 6
        for way in WAYS if places else ("default",):
            rows.add(
                f"{step} {way}",
                {
                    "accepted": right or step in {2, 4},
                    "T_a_b": (TRUE if right else np.add(TRUE, (5.0 + step, 0.0, 0.0))).tolist(),
                    "probability": 0.99 if right else 0.7,
                    "inliers": 40 if right else 5,
                    "acceptance": 0.98,
                    "common_wall_m": 10.0 * step,
                    "conflict_m": 0.1,
                    "reason": "sure" if right else "not sure enough",
                },
            )


def cells(outcome):
    (table,) = outcome.tables
    return {row[0]: dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows}


def test_the_settled_rule_merges_late_and_rightly_each_verdict_at_once_early_and_wrongly(data, tmp_path):
    finished(tmp_path / "rows")
    outcome = run(data, ExperimentSettings(), tmp_path / "rows")
    rules = cells(outcome)
    settled, at_once = list(rules.values())[:2]
    assert (settled["first merge"], settled["delay"], settled["wrong"]) == ("8", "+2", "0")
    assert settled["steps merged"] == "5 of 12"
    assert (at_once["first merge"], at_once["wrong"], at_once["withdrawn"]) == ("2", "2", "2")
    assert outcome.json["enough_at"] == 6
    figures = next(iter(outcome.json["rules"].values()))
    assert figures["worst_rms_m"] == pytest.approx(0.0, abs=1e-9)
    picture = tmp_path / "5.4.png"
    outcome.pictures[0].draw(picture)
    image = cv2.imread(str(picture))
    assert image.shape[0] > 600
    wrong_red = (np.abs(image.astype(int) - (28, 28, 200)) <= 3).all(axis=2)
    assert wrong_red.sum() > 50, "wrong verdicts are marked"


def test_any_merge_of_two_buildings_is_wrong(data, tmp_path):
    finished(tmp_path / "rows", places=False)
    apart = replace(data, maps=tuple(replace(each, pose=None) for each in data.maps))
    outcome = run(apart, ExperimentSettings(), tmp_path / "rows")
    settled, at_once = list(cells(outcome).values())
    assert (settled["first merge"], settled["wrong"]) == ("never", "0")
    assert at_once["wrong"] == "2"
    outcome.pictures[0].draw(tmp_path / "5.4.png")
    assert (tmp_path / "5.4.png").stat().st_size > 5000


def test_a_set_without_steps_or_truth_is_skipped_with_the_reason(data):
    assert lacks(data) is None
    plain = replace(data, maps=tuple(replace(each, step=None) for each in data.maps))
    assert "several steps of each" in (lacks(plain) or "")
    unknown = replace(data, kind="", maps=tuple(replace(each, pose=None) for each in data.maps))
    assert "true poses" in (lacks(unknown) or "")
