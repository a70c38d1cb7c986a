"""The systemd unit: its text is read back, and checked by systemd itself where that is installed."""

from __future__ import annotations

import configparser
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.service_unit import ServiceUnit, quoted

SYSTEMD = shutil.which("systemd-analyze")
PROGRAM = (sys.executable, "-m", "tools.cli", "run", "--lidar", "/dev/lidar")


def parsed(unit: ServiceUnit) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(unit.text())
    return parser


def read_word(text: str) -> str:
    """A word of ExecStart as systemd reads it, after systemd.service(5): quotes, escapes, specifiers, variables."""
    if text.startswith('"'):
        assert text.endswith('"')
        text = text[1:-1]
    out, at = [], 0
    while at < len(text):
        if text[at] in "\\%$":
            assert text[at] in '"\\' or text[at + 1] in (text[at] if text[at] != "\\" else '\\"')
            at += 1
        else:
            assert text[at] != '"'
        out.append(text[at])
        at += 1
    return "".join(out)


@given(st.text(st.characters(blacklist_categories=["Cc", "Cs"]), min_size=1))
def test_a_word_of_a_command_is_read_back_as_it_was(word: str) -> None:
    assert read_word(quoted(word)) == word
    assert " " not in quoted(word) or quoted(word)[0] == quoted(word)[-1] == '"'


def test_it_stops_cleanly_and_is_watched(tmp_path: Path) -> None:
    unit = parsed(ServiceUnit(PROGRAM, tmp_path, "robot", stop_s=77, watchdog_s=33))["Service"]
    assert (unit["Type"], unit["KillSignal"], unit["KillMode"]) == ("notify", "SIGINT", "mixed")
    assert (unit["TimeoutStopSec"], unit["WatchdogSec"], unit["Restart"]) == ("77", "33", "on-failure")
    assert (unit["User"], unit["WorkingDirectory"]) == ("robot", str(tmp_path))
    assert unit["ExecStart"].split() == list(PROGRAM)


def test_a_car_that_drives_is_not_started_again_and_its_guard_is_not_killed(tmp_path: Path) -> None:
    unit = parsed(ServiceUnit(PROGRAM, tmp_path, "robot", restarts=False, own_guard=True))["Service"]
    assert (unit["Restart"], unit["KillMode"]) == ("no", "process")


@pytest.mark.skipif(SYSTEMD is None, reason="systemd is not installed")
@pytest.mark.parametrize("guard", [False, True])
def test_systemd_finds_no_fault_with_it(guard: bool, tmp_path: Path) -> None:
    folder = tmp_path / "a folder"
    folder.mkdir()
    program = (*PROGRAM, "--config", "my $car 5%.yaml", 'with "quotes"')
    file = tmp_path / "mapfuse-robot.service"

    def verdict(text: str) -> str:
        file.write_text(text)
        checked = subprocess.run([str(SYSTEMD), "verify", str(file)], capture_output=True, text=True, check=False)
        return checked.stdout + checked.stderr

    text = ServiceUnit(program, folder, "root", restarts=not guard, own_guard=guard).text()
    assert verdict(text) == ""
    assert "kill mode" in verdict(text.replace("KillMode=", "KillMode=no such "))  # it does look
