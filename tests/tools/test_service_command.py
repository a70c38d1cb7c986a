"""`service`: a unit for `run` with its options."""

from __future__ import annotations

from pathlib import Path

import pytest


def settings(text: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in text.splitlines() if "=" in line)


def test_the_options_of_run_go_into_the_unit_with_absolute_paths(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.yaml").write_text("lidar: {regain_s: 25}\n")
    ended = cli("service", "--user", "robot", "--lidar", "/dev/lidar", "--config", "car.yaml", "--no-record")
    assert ended.code == 0, ended.err
    unit = settings(ended.out)
    assert unit["ExecStart"].endswith(f" run --lidar /dev/lidar --config {tmp_path}/car.yaml --no-record")
    assert unit["ExecStart"].startswith("/")
    assert (unit["User"], unit["WorkingDirectory"]) == ("robot", str(tmp_path))
    assert unit["WatchdogSec"] == "35"  # a lidar is looked for that long, and mapping is no faulty one then
    again = cli("service", "--user", "robot", "--lidar", "/dev/lidar", "--config=car.yaml", "--watchdog", "60")
    assert f"--config={tmp_path}/car.yaml" in again.out
    assert settings(again.out)["WatchdogSec"] == "60"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "no sensor"),
        (("--lidar", "x", "--bogus"), "No such option: --bogus: see mapfuse-robot run -h"),
        (("--lidar", "x", "-o", "d"), "-o: a service may start many times"),
        (("--lidar", "x", "--goal", "a", "b", "c"), "--goal a b c: expected three numbers"),
        (("--lidar", "x", "--start", "0", "0", "0", "--map", "m.yaml"), "--start: only with --goal"),
        (("--lidar", "x", "--folder", "/no/such"), "--folder /no/such: no such folder"),
    ],
)
def test_what_run_would_refuse_is_refused_here(cli, arguments, line):
    ended = cli("service", *arguments)
    assert ended.code == 2
    assert line in ended.error_lines[0]
    assert ended.out == ""


def test_a_run_that_drives_is_not_started_again_and_a_qcars_guard_outlives_it(cli):
    driving = (
        "--lidar",
        "/dev/lidar",
        "--goal",
        "1",
        "-2",
        "0.5",
        "--goal",
        "3",
        "0",
        "0",
        "--vehicle",
        "qcar:/usr/bin/python3",
    )
    unit = settings(cli("service", *driving).out)
    assert unit["ExecStart"].endswith(" run " + " ".join(driving))
    assert (unit["Restart"], unit["KillMode"]) == ("no", "process")
    mapping = settings(cli("service", "--lidar", "/dev/lidar", "--vehicle", "udp:127.0.0.1:14550").out)
    assert (mapping["Restart"], mapping["KillMode"]) == ("on-failure", "mixed")
