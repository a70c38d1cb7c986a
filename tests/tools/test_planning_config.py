"""The section `planning`: the car and the search that come out of it."""

from __future__ import annotations

import json

import pytest

from planning.path import SpeedLimits
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from tools.config import ConfigError, load
from tools.planning_config import PlanningSection


def test_the_defaults_are_the_planners_own():
    section = PlanningSection()
    assert section.vehicle() == Vehicle()
    assert section.plan_settings() == PlanSettings()
    assert section.speed.limits() == SpeedLimits()


def test_a_footprint_comes_from_the_file(tmp_path, cli):
    file = tmp_path / "car.yaml"
    file.write_text("planning:\n  footprint: [[-0.2, -0.2], [0.4, 0], [-0.2, 0.2]]\n  turning_radius_m: 1.5\n")
    section = load(file).planning
    assert section.vehicle() == Vehicle(footprint=((-0.2, -0.2), (0.4, 0.0), (-0.2, 0.2)), turning_radius_m=1.5)
    shown = json.loads(cli("config", "show", "--config", file, "--json").out)["planning"]
    assert shown["footprint"] == [[-0.2, -0.2], [0.4, 0], [-0.2, 0.2]]
    # What `config show` prints is a configuration.
    (tmp_path / "shown.yaml").write_text(cli("config", "show", "--config", file).out)
    assert load(tmp_path / "shown.yaml").planning == section


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("footprint: [[0, 0], [1, 0]]", "footprint"),
        ("footprint: [[1, 1], [2, 1], [1, 2]]", "not inside the footprint"),
        ("turning_radius_m: 0.1", "turning_radius_m"),
        ("speed: {creep_mps: 0.9}", "creep_mps 0.9 is above top_mps 0.5"),
        ("reverse_cost: 0.5", "reverse_cost"),
        ("radius: 1", "unknown key 'planning.radius'"),
    ],
)
def test_what_makes_no_car_is_told_in_one_line(tmp_path, text, words):
    (tmp_path / "c.yaml").write_text(f"planning: {{{text}}}\n")
    with pytest.raises(ConfigError, match=words) as caught:
        load(tmp_path / "c.yaml")
    assert "\n" not in str(caught.value)


def test_options_come_before_the_file():
    config = load(None).with_planning({"margin_m": 0.3, "time_limit_s": None})
    assert (config.planning.margin_m, config.planning.time_limit_s) == (0.3, 10.0)
    with pytest.raises(ConfigError, match="options: planning.margin_m"):
        load(None).with_planning({"margin_m": -1.0})
