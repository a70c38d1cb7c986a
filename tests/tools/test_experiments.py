"""`evaluate fusion`: chosen experiments on a set of maps."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from mapping.map_io import read_map, write_map
from tools.experiments import EXPERIMENTS
from tools.map_data_set import write_data_set


def test_chosen_experiments_are_written_with_an_index(cli, box_set, tmp_path):
    arguments = ("evaluate", "fusion", box_set.folder, "-o", tmp_path / "out", "--only", "4.8", "--runs", "1")
    outcome = cli(*arguments)
    assert outcome.code == 0, outcome.err
    assert len(outcome.out.splitlines()) == 1
    assert json.loads((tmp_path / "out/4.8.json").read_text())["simulated"] is True
    assert (tmp_path / "out/4.8.png").stat().st_size > 1000
    text = (tmp_path / "out/4.8.md").read_text()
    assert "Simulated on the map set" in text
    assert "Measured" not in text
    assert "(4.8.md)" in (tmp_path / "out/README.md").read_text()
    again = cli(*arguments)
    assert (again.code, again.out) == (0, outcome.out)


@pytest.mark.parametrize(("only", "code"), [("4.3,4.8", 3), ("4.8", 1)])
def test_what_a_set_lacks_is_named(cli, box_set, tmp_path, only, code):
    one_rate = replace(box_set, folder=tmp_path, maps=box_set.maps[:2])
    write_data_set(one_rate)
    outcome = cli("evaluate", "fusion", tmp_path, "-o", tmp_path / "out", "--only", only)
    assert outcome.code == code, outcome.err
    assert "no two maps of one drive and resolution at different scan rates" in outcome.out + outcome.err


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [(("--only", "9.9"), 2, "9.9"), (("--runs", "0"), 2, "runs"), (("--only", "4.3"), 1, "heterogeneous")],
)
def test_bad_input_is_one_line(cli, box_set, tmp_path, options, code, says):
    (tmp_path / "plain").mkdir()
    write_map(tmp_path / "plain/a", read_map(box_set.maps[0].path))
    outcome = cli("evaluate", "fusion", tmp_path / "plain", "-o", tmp_path / "out", *options)
    assert (outcome.code, len(outcome.error_lines)) == (code, 1), outcome.err
    assert says in outcome.error_lines[0]


def test_every_experiment_has_the_number_of_a_figure_or_table():
    for name, kind in EXPERIMENTS.items():
        assert all(part[0] in "45" for part in name.split("/"))
        assert kind.title
