from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from grp import getgrgid
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from drivers.messages import LaserScan
from drivers.pty_port import PtyPort
from drivers.recording_writer import McapRecorder
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8, A2M12, EmulatedModel
from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import read_tum

MAP_FILES = ("map.yaml", "map.pgm", "map.npz", "map.png", "trajectory.tum", "report.json")


class SilentDevice:
    """A device on a port that never says a word."""

    def receive(self, data, now_ns):
        return b""

    def due(self, now_ns):
        return b""


class NoisyDevice(SilentDevice):
    """A device that sends what no RPLIDAR sends."""

    def due(self, now_ns):
        return bytes([0x13, 0x37, 0x00, 0xFF])


def standing_lidar(model: EmulatedModel) -> PtyPort:
    """A port with an emulated lidar, served by this process, that measures 3 m all around."""

    def ranger(times_ns, theta_rad):
        return np.full(theta_rad.shape, 3.0)

    return PtyPort(RplidarEmulator(model, ranger, startup_s=0.1), model.baud)


def mapped_scans(folder: Path) -> int:
    return int(json.loads((folder / "report.json").read_text())["scans"]["mapped"])


@pytest.mark.live
@pytest.mark.parametrize(("model", "replays"), [("A2M8", ("first", "second")), ("A2M12", ("first",))])
def test_live_run_is_saved_on_ctrl_c_and_replays_to_the_same_bytes(model, replays, spawn, cli, tmp_path):
    truth = tmp_path / "truth.tum"
    emulator = spawn("emulate", "lidar", "--model", model, "--truth", truth, "--json")
    port = str(emulator.event("ready")["address"])
    live = spawn("run", "--lidar", port, "-o", tmp_path / "live", "--share-every", "1")
    emulator.event("departed")
    time.sleep(5.0)  # the car drives: a metre of speeding up, then two in its first room
    assert read_map(tmp_path / "live/map.npz").known.any(), "other robots see the map while it grows"
    ended = live.end(signal.SIGINT)
    assert ended.code == 0, ended.err
    emitted = emulator.end().out.splitlines()[-1]
    for name in (*MAP_FILES, "recording.mcap"):
        assert (tmp_path / "live" / name).stat().st_size > 0, name

    report = json.loads((tmp_path / "live/report.json").read_text())
    assert report["simulated"] is True
    assert report["dropped_scans"] == 0
    assert report["decoder"]["samples"] == pytest.approx(json.loads(emitted)["samples_emitted"], rel=0.01)

    for folder in replays:
        again = cli("replay", tmp_path / "live/recording.mcap", "-o", tmp_path / folder)
        assert again.code == 0, again.err
        for name in ("trajectory.tum", "map.pgm", "map.yaml"):
            assert (tmp_path / folder / name).read_bytes() == (tmp_path / "live" / name).read_bytes(), name
        replayed, lived = (read_map(tmp_path / where / "map.npz") for where in (folder, "live"))
        assert np.array_equal(replayed.log_odds, lived.log_odds)

    error = absolute_trajectory_error(read_tum(tmp_path / "live/trajectory.tum"), read_tum(truth), align=False)
    # Range noise is 1 cm; a laser that is mirrored, turned or late by a turn would be off by decimetres.
    assert error.max_m < 0.06
    assert error.max_deg < 1.5


@pytest.mark.live(cores=1)
def test_sigterm_ends_a_recording_cleanly(spawn, cli, tmp_path):
    emulator = spawn("emulate", "lidar", "--pose", "1.6", "3.6", "0", "--json")
    port = str(emulator.event("ready")["address"])
    recorder = spawn("record", "--lidar", port, "-o", tmp_path / "r.mcap")
    emulator.event("departed")  # a second after the first sample, however long the start took
    time.sleep(2.0)
    ended = recorder.end(signal.SIGTERM)
    assert ended.code == 0, ended.err
    info = cli("bag", "info", tmp_path / "r.mcap", "--json")
    counts = {topic["name"]: topic["count"] for topic in json.loads(info.out)["topics"]}
    assert info.code == 0
    assert counts["/lidar/raw"] > 50
    assert counts["/scan"] > 5
    assert cli("bag", "check", tmp_path / "r.mcap").code == 0


@pytest.mark.live(cores=1)
def test_lidar_lost_during_the_run_leaves_everything_saved(spawn, tmp_path):
    emulator = spawn("emulate", "lidar", "--pose", "1.6", "3.6", "0", "--json")
    port = str(emulator.event("ready")["address"])
    (tmp_path / "car.yaml").write_text("lidar: {regain_s: 1}")
    live = spawn("run", "--lidar", port, "--config", tmp_path / "car.yaml", "-o", tmp_path / "live")
    emulator.event("departed")
    time.sleep(1.5)
    emulator.end()  # the port vanishes
    _, err = live.process.communicate(timeout=30)
    assert live.process.returncode == 4
    assert err.splitlines()[-1].startswith("mapfuse-robot: ")
    assert mapped_scans(tmp_path / "live") > 5
    assert (tmp_path / "live/recording.mcap").exists()


def test_missing_port_is_one_line_and_exit_code_4(cli, tmp_path):
    outcome = cli("run", "--lidar", tmp_path / "no-such-port", "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)
    assert "no-such-port" in outcome.error_lines[0]
    assert not (tmp_path / "out").exists()


@pytest.fixture
def without_rights():
    """Root may open every port: act as nobody for a while."""
    import tools.lidar_session  # noqa: F401
    from tools.pipeline import warm_up

    warm_up()  # what is loaded now need not be read by nobody, who may not be able to
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    yield
    os.seteuid(user)


@pytest.fixture
def everybodys_folder():
    """A folder that nobody may write to as well; pytest's own belong to their user."""
    with TemporaryDirectory() as name:
        Path(name).chmod(0o777)
        yield Path(name)


def test_port_without_permission_names_the_group(cli, everybodys_folder, request):
    with PtyPort(SilentDevice(), 115200) as port:
        Path(port.name).chmod(0)
        group = getgrgid(Path(port.name).stat().st_gid).gr_name
        request.getfixturevalue("without_rights")
        outcome = cli("run", "--lidar", port.name, "-o", everybodys_folder / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)
    assert f"-aG {'dialout' if group == 'root' else group} " in outcome.error_lines[0]


def test_silent_port_is_one_line_and_exit_code_4(cli, tmp_path):
    with PtyPort(SilentDevice(), 115200) as port:
        outcome = cli("run", "--lidar", port.name, "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)
    assert "115200" in outcome.error_lines[0]


def test_wrong_baud_in_the_configuration_is_one_line_and_exit_code_4(cli, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("lidar: {baud: 115200}\n")
    with standing_lidar(A2M12) as port:
        outcome = cli("run", "--lidar", port.name, "--config", config, "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)
    assert "115200" in outcome.error_lines[0]


def test_port_that_talks_nonsense_is_one_line_and_exit_code_4(cli, tmp_path):
    with PtyPort(NoisyDevice(), 115200) as port:
        outcome = cli("run", "--lidar", port.name, "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "empty"), (b"#ROSBAG V2.0\n", "ROS 1"), (b"hello, world", "not a recording")],
)
@pytest.mark.parametrize("command", [("replay",), ("bag", "info"), ("bag", "check")])
def test_what_is_no_recording_is_refused_in_one_line(command, content, says, cli, tmp_path):
    file = tmp_path / "x.mcap"
    file.write_bytes(content)
    outcome = cli(*command, file)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert says in outcome.error_lines[0]


def test_empty_folder_is_refused_in_one_line(cli, tmp_path):
    outcome = cli("replay", tmp_path)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("grid: {resolutoin_m: 0.05}", "unknown key 'grid.resolutoin_m'"),
        ("mapping: {}", "unknown key 'mapping'"),
        ("grid: {resolution_m: -1}", "grid.resolution_m"),
        ("grid: [", "not YAML"),
        ("- 1", "expected sections"),
    ],
)
def test_unusable_configuration_is_one_line_and_exit_code_2(text, says, cli, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text(text)
    for command in (["config", "show"], ["run", "--lidar", "/dev/null"], ["record", "--lidar", "x", "-o", "y"]):
        outcome = cli(*command, "--config", config)
        assert (outcome.code, len(outcome.error_lines)) == (2, 1)
        assert says in outcome.error_lines[0]


def test_yaml_without_an_image_is_one_line_and_exit_code_1(cli, tmp_path):
    world = tmp_path / "world.yaml"
    world.write_text("resolution: 0.05\norigin: [0, 0, 0]\n")
    outcome = cli("emulate", "lidar", "--world", world, "--pose", "0", "0", "0")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "image" in outcome.error_lines[0]


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"],
        ["nonsense"],
        ["emulate", "lidar", "--model", "A3M1"],
        ["emulate", "lidar", "--world", "x.yaml"],
        ["emulate", "lidar", "--pose", "50", "3", "0"],
        ["emulate", "lidar", "--pose", "5", "7", "0"],
        ["emulate", "lidar", "--pose", "0", "0", "0", "--trajectory", "t.tum"],
        ["run", "--lidar", "x", "--resolution", "0.05", "--cells-per-meter", "20"],
        ["run", "--lidar", "x", "--cells-per-meter", "0"],
        ["replay", "x", "--odometry", "guess"],
        ["replay", "x", "--bogus"],
        ["replay"],
        ["bag", "nonsense"],
        ["plan", "m.yaml", "--start", "0", "0"],
        ["demo", "--seed", "-1"],
    ],
)
def test_wrong_use_is_exit_code_2_and_one_line(arguments, cli):
    outcome = cli(*arguments)
    assert (outcome.code, outcome.err.count("\n"), outcome.out) == (2, 1, "")
    assert outcome.error_lines


def test_a_group_alone_shows_its_help(cli):
    outcome = cli("bag")
    assert outcome.code == 2
    assert "recover" in outcome.err + outcome.out


def test_every_command_has_help(cli):
    for command in (
        [],
        ["run"],
        ["replay"],
        ["record"],
        ["demo"],
        ["bench"],
        ["bench", "pipeline"],
        ["bench", "slam"],
        ["evaluate", "rates"],
        ["emulate", "lidar"],
        ["bag", "info"],
        ["bag", "check"],
        ["bag", "recover"],
        ["bag", "convert"],
        ["config", "show"],
        ["config", "schema"],
    ):
        outcome = cli(*command, "--help")
        assert outcome.code == 0
        assert "Usage:" in outcome.out


def test_config_schema_describes_every_section(cli):
    schema = json.loads(cli("config", "schema").out)
    assert set(schema["properties"]) == {
        "lidar", "depth", "replay", "odometry", "slam", "grid", "planning", "vehicle", "drive",
    }  # fmt: skip


def test_version_is_printed(cli):
    assert cli("--version").out.startswith("mapfuse-robot 0.")


@pytest.mark.parametrize(("seed", "options"), [(0, ()), *((seed, ("--no-refine",)) for seed in (1, 2, 3))])
def test_recording_cut_at_a_random_byte_is_mapped_as_far_as_it_goes(seed, options, cli, tmp_path, project_root):
    whole = (project_root / "recordings/simulated_office_a2m12.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: np.random.default_rng(seed).integers(len(whole) // 5, len(whole) // 2)])
    outcome = cli("replay", cut, "-o", tmp_path / "out", *options)
    assert outcome.code == 3, outcome.err
    assert "damaged recording" in outcome.err
    assert mapped_scans(tmp_path / "out") > 20
    golden = read_tum(project_root / "recordings/simulated_office_a2m12.golden.tum")
    mapped = read_tum(tmp_path / "out/trajectory.tum")
    assert np.array_equal(mapped.stamps_ns, golden.stamps_ns[: len(mapped)])

    assert cli("bag", "info", cut).code == 3
    assert cli("bag", "check", cut).code == 3
    assert cli("bag", "recover", cut, tmp_path / "whole.mcap").code == 3
    assert cli("bag", "check", tmp_path / "whole.mcap").code == 0
    again = cli("replay", tmp_path / "whole.mcap", "-o", tmp_path / "again", *options)
    assert again.code == 0
    assert (tmp_path / "again/trajectory.tum").read_bytes() == (tmp_path / "out/trajectory.tum").read_bytes()


def test_recovery_never_overwrites(cli, tmp_path, project_root):
    (tmp_path / "kept.mcap").write_text("years of work")
    outcome = cli("bag", "recover", project_root / "recordings/simulated_office_a2m12.mcap", tmp_path / "kept.mcap")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert (tmp_path / "kept.mcap").read_text() == "years of work"


def test_bench_measures_beside_the_lidars_own_pace(cli, round_trip):
    report = json.loads(cli("bench", round_trip, "--json").out)
    assert report["simulated"] is True
    assert report["turn_ms"] == pytest.approx(100.0, rel=0.02)
    assert [stage["stage"] for stage in report["stages"]] == ["decode", "map"]
    assert all(0 < stage["median_ms"] <= stage["p95_ms"] <= stage["max_ms"] for stage in report["stages"])
    assert "SIMULATED" in cli("bench", round_trip).out.upper()


@pytest.mark.parametrize("command", ["run", "replay"])
def test_folder_that_cannot_be_written_is_one_line_and_exit_code_1(command, cli, tmp_path, project_root):
    file = tmp_path / "file"
    file.write_text("years of work")
    if command == "replay":
        outcome = cli("replay", project_root / "recordings/simulated_office_a2m12.mcap", "-o", file)
    else:
        with standing_lidar(A2M8) as port:
            outcome = cli("run", "--lidar", port.name, "-o", file)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert str(file) in outcome.error_lines[0]
    assert file.read_text() == "years of work"


def test_recording_is_never_overwritten_by_a_second_run(cli, tmp_path):
    (tmp_path / "recording.mcap").write_text("years of work")
    with standing_lidar(A2M8) as port:
        outcome = cli("run", "--lidar", port.name, "-o", tmp_path)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert (tmp_path / "recording.mcap").read_text() == "years of work"


def test_scans_of_which_none_can_be_mapped_are_one_line_and_exit_code_1(cli, tmp_path):
    blind = LaserScan(10**18, np.linspace(0, 6, 360), np.full(360, np.nan), np.zeros(360), 0.1, 12.0)
    with McapRecorder(tmp_path / "blind.mcap", metadata={}) as recorder:
        for number in range(5):
            recorder.put(replace(blind, stamp_ns=10**18 + number * 10**8))
    outcome = cli("replay", tmp_path / "blind.mcap", "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "none of its 5 scans" in outcome.error_lines[0]
    assert not (tmp_path / "out").exists()


def test_wheels_alone_cannot_map_live(cli, tmp_path):
    config = tmp_path / "c.yaml"
    config.write_text("odometry: {source: wheel}\n")
    outcome = cli("run", "--lidar", "nowhere", "--config", config)
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)


@pytest.mark.parametrize("command", [("run",), ("record",)])
def test_where_results_cannot_go_is_told_before_the_lidar_is_touched(command, cli, tmp_path):
    (tmp_path / "file").write_text("years of work")
    outcome = cli(*command, "--lidar", tmp_path / "no-such-port", "-o", tmp_path / "file/below")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "cannot write results" in outcome.error_lines[0]


@pytest.mark.parametrize(
    "command",
    [
        ("replay",),
        ("bench",),
        ("bag", "info"),
        ("bag", "check"),
        ("evaluate", "plans"),
        ("evaluate", "registration"),
        ("emulate", "lidar", "--link"),
        ("plan", "--start", "0", "0", "0", "--goal", "0", "0", "0"),
        ("demo", "-o"),
    ],
)
def test_a_name_too_long_for_the_disk_is_one_line(command, cli, tmp_path):
    outcome = cli(*command, tmp_path / ("x" * 300 + ".yaml"))
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)


@pytest.mark.parametrize("command", [("--version",), ("--help",), ("config", "show"), ("config", "schema")])
def test_output_that_finds_no_room_is_one_line_and_exit_code_1(command, project_root):
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "tools.cli", *command],
            check=False,
            cwd=project_root,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert ended.returncode == 1
    assert ended.stderr == "mapfuse-robot: No space left on device: check where the output goes\n"


@pytest.mark.real_data
def test_other_peoples_recordings_are_listed_and_refused_by_replay_in_one_line(data_dir, tmp_path, cli):
    files = [*sorted((data_dir / "mcap").glob("*.mcap")), *sorted((data_dir / "rosbag_misc").glob("*.db3"))]
    assert len(files) >= 7
    for file in files:
        info = cli("bag", "info", file, "--json")
        assert info.code == 0, info.err
        topics = json.loads(info.out)["topics"]
        assert sum(topic["count"] for topic in topics) > 0
        assert all("/msg/" in topic["type"] or "/srv/" in topic["type"] for topic in topics)
        replay = cli("replay", file, "-o", tmp_path / "out")
        assert replay.code == 1
        assert replay.err.count("\n") == 1
        assert "no LaserScan" in replay.err
    assert not (tmp_path / "out").exists()


@pytest.mark.real_data
def test_ros1_bags_are_refused_in_one_line_that_names_the_format(data_dir, cli):
    files = [file for file in (data_dir / "rosbag_misc").glob("*.bag") if "librealsense" not in file.name]
    assert len(files) >= 3
    for file in files:
        for verb in (["replay"], ["bag", "info"]):
            refused = cli(*verb, file)
            assert refused.code == 1
            assert refused.err.count("\n") == 1
            assert "ROS 1 bag" in refused.err


@pytest.mark.parametrize("command", [("run",), ("record", "-o", "r.mcap")])
def test_without_a_sensor_is_wrong_usage(command, cli):
    outcome = cli(*command)
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)
    assert "--depth auto" in outcome.error_lines[0]


def test_a_camera_that_is_not_there_is_a_missing_device(cli, tmp_path):
    outcome = cli("run", "--depth", "emulated:nowhere", "-o", tmp_path / "out")
    assert (outcome.code, len(outcome.error_lines)) == (4, 1)
    assert not (tmp_path / "out").exists()
