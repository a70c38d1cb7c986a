from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from mapping.odometry import OdometrySettings
from mapping.sensor_models import LidarModel
from mapping.slam import MappingSettings
from tools.config import Config, ConfigError, GridSection, OdometrySection, load, parse


def test_defaults_are_those_of_the_mapping_layer():
    assert Config().mapping_settings() == MappingSettings()


def test_every_setting_of_mapping_can_be_configured():
    keys = set(OdometrySection.model_fields) | set(GridSection.model_fields)
    assert {field.name for cls in (OdometrySettings, LidarModel) for field in fields(cls)} <= keys


def test_file_overlays_the_defaults(tmp_path):
    file = tmp_path / "c.yaml"
    file.write_text("grid: {resolution_m: 0.1}\nlidar: {mount: {yaw_rad: 1.5, inverted: true}}\n")
    config = load(file)
    assert config.mapping_settings().resolution_m == 0.1
    assert config.mount().inverted
    assert np.array_equal(config.mount().pose, [Config().lidar.mount.x_m, 0.0, 1.5])


def test_empty_file_is_the_defaults(tmp_path):
    file = tmp_path / "c.yaml"
    file.write_text("# nothing\n")
    assert load(file) == load(None) == Config()


def test_what_is_shown_can_be_read_again(cli, tmp_path):
    file = tmp_path / "c.yaml"
    file.write_text(cli("config", "show").out)
    assert load(file) == Config()
    assert YAML(typ="safe").load(file.read_text()) == Config().model_dump()


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (
            {"lidar": {"mount": {"yaw_deg": 90}}},
            "unknown key 'lidar.mount.yaw_deg'; known here: x_m, y_m, z_m, yaw_rad",
        ),
        ({"grid": {"hit_probability": 0.4}}, "grid.hit_probability"),
        ({"odometry": {"voxel_m": float("nan")}}, "odometry.voxel_m"),
        ({"replay": {"sweep": "sideways"}}, "replay.sweep"),
        (["grid"], "expected sections"),
        ({"lidar": 3}, "lidar"),
        ({"lidar": {"baud": 10**14}}, "lidar.baud"),
        ({"grid": {"max_range_m": 20000}}, "grid.max_range_m"),
    ],
)
def test_error_names_origin_key_and_value_in_one_line(values, says):
    with pytest.raises(ConfigError, match=r"^here: [^\n]*$") as error:
        parse(values, "here")
    assert says in str(error.value)


def test_resolution_is_accepted_in_both_ways():
    assert Config().with_resolution(0.1, None).grid.resolution_m == 0.1
    assert Config().with_resolution(None, 20.0).grid.resolution_m == 0.05
    assert Config().with_resolution(None, None) == Config()
    with pytest.raises(ConfigError, match="twice"):
        Config().with_resolution(0.05, 20.0)
    with pytest.raises(ConfigError, match="resolution_m"):
        Config().with_resolution(None, 0.0)


def test_configuration_cannot_be_changed():
    grid: Any = Config().grid
    with pytest.raises(ValueError, match="frozen"):
        grid.resolution_m = 1.0


@pytest.mark.parametrize(("text", "says"), [("depth:\n  mount: [1, 2]\n", "x_m, y_m"), ("grid: [1\n", "line 2")])
def test_what_is_wrong_is_said_in_the_words_of_the_file(tmp_path, text, says):
    file = tmp_path / "config.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=says):
        load(file)
