"""A session in this process, with an emulated lidar that behaves as the command's does not."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.messages import LidarStream
from drivers.pty_port import PtyPort
from drivers.recording_reader import open_recording
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from tools.config import ConfigError, parse
from tools.emulated_camera import EmulatedCar
from tools.emulation import Drive, simulated_lidar
from tools.lidar_session import SensorPorts, run_session, session_is_whole
from tools.replay_run import recorded_config, replay_recording
from tools.signals import Stop


def live_run(folder, config):
    """Map a lidar that turns already for a while: its first samples come with the answer to the scan request."""
    drive = Drive.tour("office")
    emulator = RplidarEmulator(A2M8, simulated_lidar("office", drive, noise=True, seed=3), startup_s=-0.2)
    stop = Stop()
    with PtyPort(emulator, A2M8.baud) as port:
        return run_session(SensorPorts(port.name), config, lambda: begun(folder, 2.5, stop), stop, record=True)


def begun(folder, seconds, stop):
    """Make the session's folder when the sensors are started: from then on the seconds to its end count."""
    folder.mkdir()
    threading.Timer(seconds, stop.set).start()
    return folder


@pytest.mark.live(cores=1)
@pytest.mark.parametrize(
    "settings",
    [{}, {"replay": {"scan_topic": "/scan", "base_frame": "base_footprint"}, "lidar": {"mount": {"yaw_rad": 0.5}}}],
)
def test_live_and_replay_agree_from_the_first_byte_on(settings, tmp_path):
    report, fault = live_run(tmp_path / "live", parse(settings, "test"))
    assert fault is None
    assert report["scans"]["mapped"] > 15
    with open_recording(tmp_path / "live/recording.mcap") as recording:
        again = replay_recording(recording, recorded_config(recording), tmp_path / "again", on_progress=lambda _: None)
    assert again["decoder"] == report["decoder"]
    for name in ("trajectory.tum", "map.pgm"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    with np.load(tmp_path / "live/map.npz") as live, np.load(tmp_path / "again/map.npz") as replayed:
        assert np.array_equal(live["log_odds"], replayed["log_odds"])


@pytest.mark.live(cores=1)
def test_a_lidar_that_is_unplugged_for_a_while_costs_that_while_and_no_more(tmp_path):
    drive, link, folder, stop = Drive.standing((1.6, 3.6, 0.3)), tmp_path / "lidar", tmp_path / "live", Stop()
    emulator = RplidarEmulator(A2M8, simulated_lidar("office", drive, noise=True, seed=3), startup_s=0.1)
    folder.mkdir()

    def pull() -> None:
        port.unplug()
        emulator.power_up(time.monotonic_ns())

    def begin() -> Path:
        """The lidar turns: from here on the seconds count."""
        for seconds, act in ((2.0, pull), (2.7, port.plug_in), (6.0, stop.set)):
            threading.Timer(seconds, act).start()
        return folder

    with PtyPort(emulator, A2M8.baud, link=link) as port:
        report, fault = run_session(SensorPorts(str(link)), parse({}, "test"), begin, stop, record=True)
    assert fault is None
    assert report["lidar_losses"] == 1
    assert session_is_whole(report)
    with open_recording(folder / "recording.mcap") as recording:
        streams = [message for message in recording if isinstance(message, LidarStream)]
    assert [stream.mode for stream in streams] == ["Sensitivity", "Sensitivity"]
    with open_recording(folder / "recording.mcap") as recording:
        again = replay_recording(recording, recorded_config(recording), tmp_path / "again", on_progress=lambda _: None)
    assert again["decoder"] == report["decoder"]
    assert (tmp_path / "again/map.pgm").read_bytes() == (folder / "map.pgm").read_bytes()
    assert report["scans"]["mapped"] > 20


@pytest.mark.live(cores=1)
@pytest.mark.parametrize(("live_s", "least", "most"), [(0.5, 3, 8), (0.0, 1, 1)])
def test_the_map_goes_into_the_recording_while_the_car_drives(live_s, least, most, tmp_path):
    report, _ = live_run(tmp_path / "live", parse({"grid": {"live_s": live_s}}, "test"))
    assert report["scans"]["mapped"] > 15
    assert least <= report["recording"]["written"]["/map"] <= most


def test_wheels_are_refused_before_the_port_is_opened(tmp_path):
    with pytest.raises(ConfigError, match="wheel"):
        run_session(
            SensorPorts("nowhere"),
            parse({"odometry": {"source": "wheel"}}, "test"),
            lambda: tmp_path,
            Stop(),
            record=True,
        )


@pytest.mark.live(cores=1)
def test_lidar_and_camera_of_one_car_and_the_same_maps_from_the_recording(tmp_path):
    drive = Drive.tour("office")
    ranger = simulated_lidar("office", drive, noise=True, seed=3)
    emulator = RplidarEmulator(A2M8, ranger, startup_s=-0.2)
    car = tmp_path / "car.json"
    EmulatedCar("office", drive.truth, time.monotonic_ns() + 2 * 10**9).write(car)
    # A live run leaves images out where mapping is more than 15 of them late, a replay never does: at 6 a second those
    # are 2.5 s, and a busy computer has time enough to render what the camera sees.
    config = parse({"depth": {"width": 424, "height": 240, "fps": 6}}, "test")
    folder, stop = tmp_path / "live", Stop()
    with PtyPort(emulator, A2M8.baud) as port:
        report, fault = run_session(
            SensorPorts(port.name, f"emulated:{car}"), config, lambda: begun(folder, 5.0, stop), stop, record=True
        )
    assert fault is None
    assert session_is_whole(report)
    assert report["depth"]["dropped_before_mapping"] == report["depth"]["dropped"] == 0
    assert report["depth"]["taken"] > 5
    assert report["recording"]["written"]["/camera/depth/image_rect_raw"] == report["camera"]["frames"] > 12
    with open_recording(folder / "recording.mcap") as recording:
        replay_recording(recording, recorded_config(recording), tmp_path / "again", on_progress=lambda _: None)
    for name in ("map", "depth_map", "both_map"):
        live, again = (np.load(each / f"{name}.npz")["log_odds"] for each in (folder, tmp_path / "again"))
        assert np.array_equal(live, again), name


@pytest.mark.live(cores=1)
def test_a_camera_alone_is_mapped_and_recorded(tmp_path):
    config = parse({"depth": {"width": 424, "height": 240, "fps": 15}}, "test")
    stop = Stop()
    report, fault = run_session(
        SensorPorts(None, "emulated:office"), config, lambda: begun(tmp_path / "live", 5.0, stop), stop, record=True
    )
    assert fault is None
    assert report["simulated"]
    assert report["scans"]["mapped"] > 10
    assert report["map"]["free_m2"] > 1.0
