"""A session in this process, with an emulated lidar that behaves as the command's does not."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from drivers.pty_port import PtyPort
from drivers.recording_reader import open_recording
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from tools.config import ConfigError, parse
from tools.emulation import Drive, simulated_lidar
from tools.lidar_session import run_session
from tools.replay_run import recorded_config, replay_recording
from tools.signals import Stop


def live_run(folder, config):
    """Map for three seconds a lidar that turns already: its first samples come with the answer to the scan request."""
    drive = Drive.tour("office")
    emulator = RplidarEmulator(A2M8, simulated_lidar("office", drive, noise=True, seed=3), startup_s=-0.2)
    stop = Stop()
    timer = threading.Timer(4.0, stop.set)
    folder.mkdir()
    with PtyPort(emulator, A2M8.baud) as port:
        timer.start()
        return run_session(port.name, config, lambda: folder, stop, record=True)


@pytest.mark.live
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


@pytest.mark.live
@pytest.mark.parametrize(("live_s", "least", "most"), [(0.5, 3, 8), (0.0, 1, 1)])
def test_the_map_goes_into_the_recording_while_the_car_drives(live_s, least, most, tmp_path):
    report, _ = live_run(tmp_path / "live", parse({"grid": {"live_s": live_s}}, "test"))
    assert report["scans"]["mapped"] > 15
    assert least <= report["recording"]["written"]["/map"] <= most


def test_wheels_are_refused_before_the_port_is_opened(tmp_path):
    with pytest.raises(ConfigError, match="wheel"):
        run_session(
            "nowhere",
            parse({"odometry": {"source": "wheel"}}, "test"),
            lambda: tmp_path,
            Stop(),
            record=True,
        )
