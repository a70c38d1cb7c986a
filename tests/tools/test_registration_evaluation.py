"""`evaluate registration`: how a pair is judged, which pairs are chosen, and the whole of it with a known answer."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from fusion.alignment import Alignment, Alternative
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.errors import UsageError
from tools.pair_files import MapPair, PairTruth, write_pairs
from tools.registration_evaluation import chosen_pairs, evaluate_registration, judged

TRUE_POSE = np.array([8.0, -5.0, 2.0])
POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2))
TRUTH = PairTruth(TRUE_POSE, se2.transform_points(TRUE_POSE, POINTS), POINTS)
A, B = Path("a.yaml"), Path("b.yaml")
SAME = MapPair("same", A, B, "hall", "hall", "lidar", "low", 0.3, 9.0, TRUTH)
OTHER = MapPair("other", A, B, "hall", "house", "camera")


@pytest.mark.parametrize(
    ("pair", "shift_m", "turn_deg", "aligned"),
    [
        (SAME, 0.05, 0.0, True),
        (SAME, 0.49, 0.0, True),
        (SAME, 0.51, 0.0, False),
        (SAME, 0.0, 1.0, True),
        (SAME, 0.0, 4.0, False),
        (OTHER, 0.0, 0.0, False),
    ],
)
@pytest.mark.parametrize("accepted", [True, False])
def test_aligned_is_a_matter_of_the_pose_and_not_of_the_verdict(pair, shift_m, turn_deg, aligned, accepted):
    about = se2.transform_points(TRUE_POSE, POINTS).mean(axis=0)
    turn = np.array([0.0, 0.0, np.radians(turn_deg)])
    turned = se2.compose(se2.compose([*about, 0.0], turn), se2.compose([*-about, 0.0], TRUE_POSE))
    row = judged(pair, Alignment(turned + np.array([0.0, shift_m, 0.0]), accepted, "as told"))
    assert (row["aligned"], row["accepted"]) == (aligned, accepted)
    if pair.truth is not None:
        assert row["rotation_deg"] == pytest.approx(turn_deg, abs=1e-3)
        if turn_deg == 0.0:
            assert row["rms_m"] == pytest.approx(shift_m, abs=1e-3)


def test_a_row_can_be_written_as_json_whatever_was_found():
    other = (Alternative(TRUE_POSE, 0.1),)
    full = Alignment(TRUE_POSE, True, "told", 9, 0.99, 0.5, 0.9, np.eye(3) * 1e-4, other)
    for alignment in (full, Alignment(None, False, "nothing")):
        assert json.loads(json.dumps(judged(SAME, alignment)))["reason"] == alignment.reason


def test_the_squared_error_counts_in_units_of_the_covariance():
    sigma = np.array([0.1, 0.2, 0.01])
    off = Alignment(TRUE_POSE + 2.0 * sigma, True, "two sigma each", covariance=np.diag(sigma**2))
    assert judged(SAME, off)["nees"] == pytest.approx(3 * 4.0)
    singular = Alignment(TRUE_POSE, True, "no inverse", covariance=np.zeros((3, 3)))
    assert judged(SAME, singular)["nees"] is None
    around = Alignment(TRUE_POSE + np.array([0.0, 0.0, 2.0 * np.pi]), True, "a turn more", covariance=np.eye(3))
    assert judged(SAME, around)["nees"] == pytest.approx(0.0, abs=1e-3)


@pytest.fixture
def listed(tmp_path):
    """Four pairs of tiny maps: b is a, moved by TRUE_POSE."""
    random = np.random.default_rng(0)
    for name in ("a", "b"):
        cells = np.where(random.random((9, 9)) < 0.2, 3.0, -3.0).astype(np.float32)
        write_map(tmp_path / name, OccupancyGrid(cells, 0.05, np.zeros(3)))
    a, b = tmp_path / "a.yaml", tmp_path / "b.yaml"
    pairs = [
        MapPair("low", a, b, "hall", "hall", "lidar", "low", 0.3, 9.0, TRUTH),
        MapPair("camera", a, b, "house", "house", "camera", "low", 0.3, 2.0, TRUTH),
        MapPair("apart", a, b, "hall", "hall", "camera"),
        MapPair("else", a, b, "hall", "house", "lidar"),
    ]
    write_pairs(tmp_path, pairs, "a test")
    return tmp_path


@pytest.mark.parametrize(
    ("only", "names"),
    [
        ([], ["low", "camera", "apart", "else"]),
        (["lidar"], ["low", "else"]),
        (["camera/low"], ["camera"]),
        (["true"], ["low", "camera"]),
        (["wrong/same", "true/house"], ["camera", "apart"]),
        (["other"], ["else"]),
        (["hall"], ["low", "apart", "else"]),
    ],
)
def test_a_filter_keeps_what_all_its_words_fit(listed, only, names):
    assert [pair.name for pair in chosen_pairs(listed, only, None, 0)] == names


def test_unknown_words_and_what_fits_nothing_are_told(listed):
    for only in (["sonar"], ["warped"]):
        with pytest.raises(UsageError):
            chosen_pairs(listed, only, None, 0)


def test_a_sample_is_of_its_size_in_order_and_the_same_again(listed):
    draws = [[pair.name for pair in chosen_pairs(listed, [], 2, seed)] for seed in [*range(30), *range(30)]]
    assert draws[:30] == draws[30:]
    assert all(len(set(draw)) == 2 for draw in draws)
    assert all(name in {each for draw in draws for each in draw} for name in ("low", "camera", "apart", "else"))
    assert ["camera", "low"] not in draws


def knows_the_answer(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> Alignment:
    """Accept the true pose whatever the maps are."""
    assert a.log_odds.shape == b.log_odds.shape == (9, 9)
    return Alignment(TRUE_POSE, True, f"seed {seed}", probability=0.5)


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_truth_aligns_all_true_pairs_and_merges_all_wrong_ones(listed, jobs):
    rows: list[dict[str, object]] = []
    register = knows_the_answer if jobs == 1 else importable_register()
    report = evaluate_registration(listed, register, chosen_pairs(listed, [], None, 0), 4, jobs, rows.append)
    assert rows == report["rows"]
    assert [row["pair"] for row in rows] == ["low", "camera", "apart", "else"]
    if jobs == 1:
        assert (report["true_pairs"]["aligned"], report["true_pairs"]["pairs"]) == (2, 2)
        assert report["false_merges"]["all"] == {"pairs": 2, "accepted": 2, "at_most": None}
        assert report["calibration"]["brier"] == pytest.approx(0.25)
        assert {row["reason"] for row in rows} == {"seed 4"}


def knows_nothing(a: OccupancyGrid, b: OccupancyGrid, seed: int) -> Alignment:
    """Refuse."""
    del a, b, seed
    return Alignment(None, False, "no idea")


def test_each_pair_may_have_a_registration_of_its_own(listed):
    registered = [knows_the_answer, knows_nothing, knows_nothing, knows_the_answer]
    report = evaluate_registration(listed, registered, chosen_pairs(listed, [], None, 0), 4, 1, lambda _: None)
    assert [row["accepted"] for row in report["rows"]] == [True, False, False, True]
    assert report["true_pairs"]["aligned"] == 1


def importable_register():
    """A registration that another process can import."""
    from functools import partial

    from tools.registration_evaluation import register_by

    return partial(register_by, "default")


def test_the_command_shows_the_table_and_writes_rows_report_and_plots(listed, cli, tmp_path):
    output = tmp_path / "out"
    outcome = cli("evaluate", "registration", listed, "--only", "true", "-o", output)
    assert outcome.code == 0, outcome.err
    assert "all true pairs" in outcome.out
    assert len((output / "rows.jsonl").read_text().splitlines()) == 2
    assert json.loads((output / "report.json").read_text())["true_pairs"]["pairs"] == 2
    for name in ("success", "reliability", "scores"):
        assert (output / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    as_json = cli("evaluate", "registration", listed, "--sample", "3", "--json", "--method", "thesis")
    assert Counter(row["true"] for row in json.loads(as_json.out)["rows"]).total() == 3


def test_the_command_tells_bad_input_in_one_line(listed, cli, tmp_path):
    for arguments, code in (([tmp_path / "none"], 1), ([listed, "--only", "sonar"], 2)):
        outcome = cli("evaluate", "registration", *arguments)
        assert (outcome.code, len(outcome.error_lines)) == (code, 1)
    (listed / "b.pgm").unlink()
    outcome = cli("evaluate", "registration", listed)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
