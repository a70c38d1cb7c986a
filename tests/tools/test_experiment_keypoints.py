"""Experiments 4.3 and 4.4: counts by detector, resolution, rate and processing."""

from __future__ import annotations

import pytest

from fusion.features import count_keypoints
from fusion.occupancy_image import occupancy_image, rescale_bicubic
from mapping.map_io import read_map
from tools.experiment import ExperimentSettings
from tools.experiment_keypoints import DETECTORS, IMAGES, keypoints_by_detector, rescaled_keypoints
from tools.map_data_set import data_hash


@pytest.fixture
def settings():
    return ExperimentSettings(1, 0, 1)


def test_keypoints_are_counted_on_every_map_as_it_is(box_set, settings, tmp_path):
    outcome = keypoints_by_detector(box_set, settings, tmp_path)
    counts = outcome.json["keypoints"]
    assert list(counts) == [each.name for each in box_set.maps]
    for each in box_set.maps:
        image = occupancy_image(read_map(each.path))
        assert counts[each.name] == {detector: count_keypoints(image, detector) for detector in DETECTORS}
    assert min(counts["r20-k1"].values()) > 0
    table = next(table for table in outcome.tables if table.title.startswith("KAZE"))
    assert table.rows[0] == ["10", str(counts["r10-k1"]["kaze"]), str(counts["r10-k2"]["kaze"])]


def test_rescaled_maps_are_counted_at_both_resolutions(box_set, settings, tmp_path):
    outcome = rescaled_keypoints(box_set, settings, tmp_path)
    counts = outcome.json["keypoints"]
    grid = read_map(box_set.maps[0].path)
    image = rescale_bicubic(occupancy_image(grid), 0.1, 1.0 / 20.0)
    assert counts["r10-k1"]["O to 20"] == count_keypoints(image, "kaze")
    assert {len(row) for row in counts.values()} == {2 * len(IMAGES)}
    assert outcome.tables[0].rows[0][0] == "8"


def test_rows_of_an_earlier_run_are_taken(box_set, settings, tmp_path):
    from tools.finished_rows import FinishedRows

    rows = FinishedRows(tmp_path / "keypoints.jsonl", data_hash(box_set))
    for each in box_set.maps:
        rows.add(each.name, dict.fromkeys(DETECTORS, 7))
    outcome = keypoints_by_detector(box_set, settings, tmp_path)
    assert {value for row in outcome.json["keypoints"].values() for value in row.values()} == {7}
