from __future__ import annotations

import threading
from itertools import repeat

import numpy as np
import pytest

from drivers.d435_emulated_stream import StreamFaults
from drivers.d435_emulator import D435Emulator
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.errors import DeviceLostError
from drivers.messages import DepthImage, LaserScan, Pinhole, Transform
from drivers.reconnecting_camera import ReconnectingCamera
from drivers.recording_reader import open_recording
from drivers.recording_writer import McapRecorder
from mapping.depth_projection import CameraMount, project
from mapping.slam import MappedScan
from tools.config import Config
from tools.depth_flow import DepthFlow
from tools.live_run import LiveReading, SensorThread, record_live, run_live
from tools.pipeline import MappingFlow

TURN_S = 0.1


def scan(number):
    angles = -np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ranges = np.minimum(2.0 / np.maximum(np.abs(np.cos(angles)), 1e-9), 1.5 / np.maximum(np.abs(np.sin(angles)), 1e-9))
    return LaserScan(round(number * TURN_S * 1e9), angles, ranges, np.linspace(0, TURN_S, 200), 0.1, 12.0)


class ScriptedLidar:
    """Yields its messages, then fails or waits to be stopped."""

    def __init__(self, messages, failure=None):
        self._messages = messages
        self._failure = failure
        self._stopped = threading.Event()

    def __iter__(self):
        yield from self._messages
        if self._failure is not None:
            raise self._failure
        self._stopped.wait(10.0)

    def request_stop(self):
        self._stopped.set()


def run(lidar, until=None):
    flow = MappingFlow(Config(), Config().mount())
    put: list[object] = []
    mapped: list[MappedScan] = []
    stop = threading.Event()

    def on_mapped(one):
        mapped.append(one)
        if len(mapped) == until:
            stop.set()

    outcome = run_live(lidar, flow, stop, put=put.append, on_mapped=on_mapped)
    return outcome, put, mapped


def test_run_ends_when_asked_to_and_maps_what_was_on_the_way():
    outcome, put, mapped = run(ScriptedLidar([scan(n) for n in range(8)]), until=1)
    assert outcome.fault is None
    assert len(mapped) == 8
    assert sum(isinstance(message, LaserScan) for message in put) >= 8


def test_each_mapped_pose_is_put_out_as_a_transform():
    _, put, mapped = run(ScriptedLidar([scan(n) for n in range(4)]), until=4)
    transforms = [message for message in put if isinstance(message, Transform)]
    frames = [(transform.stamp_ns, transform.parent, transform.child) for transform in transforms]
    assert frames == [(one.stamp_ns, *edge) for one in mapped for edge in (("map", "odom"), ("odom", "base_link"))]


def test_lost_device_ends_the_run_with_all_scans_mapped():
    outcome, _, mapped = run(ScriptedLidar([scan(n) for n in range(5)], DeviceLostError("port: gone")))
    assert str(outcome.fault) == "port: gone"
    assert len(mapped) == 5


def test_unknown_error_of_the_sensor_thread_is_raised():
    with pytest.raises(ZeroDivisionError):
        run(ScriptedLidar([scan(0)], ZeroDivisionError()))


def test_full_queue_drops_the_oldest_scan_and_counts_it():
    sensor = SensorThread(
        ScriptedLidar([scan(n) for n in range(10)], DeviceLostError("x")), lambda _: None, queue_scans=4
    )
    sensor.start()
    sensor.stop()
    left = []
    while (message := sensor.take(0.0)) is not None:
        left.append(message.stamp_ns)
    assert sensor.dropped_scans == 6
    assert left == [scan(n).stamp_ns for n in range(6, 10)]


def test_recording_alone_passes_on_every_message():
    put: list[object] = []
    outcome = record_live(
        ScriptedLidar([scan(n) for n in range(3)], DeviceLostError("x")), threading.Event(), put=put.append
    )
    assert len([message for message in put if isinstance(message, LaserScan)]) >= 3
    assert outcome.fault is not None


def camera_that_is_lost(at):
    """An emulated D435 on the real driver, which vanishes at a frame."""
    image = np.full((240, 424), 1500, np.uint16)
    emulator = D435Emulator(repeat(image), faults=StreamFaults(unplug_at=at))
    return open_depth_camera(emulator.path, DepthMode(424, 240, 30), calls=emulator)


@pytest.mark.live(cores=1)
def test_a_lost_camera_does_not_end_a_run_that_has_a_lidar(caplog):
    camera = camera_that_is_lost(at=3)
    flow = MappingFlow(
        Config(), Config().mount(), depth=DepthFlow(Config(), lambda _: CameraMount(), alone=False, projection=project)
    )
    put: list[object] = []
    stop = threading.Event()
    timer = threading.Timer(1.0, stop.set)
    timer.start()
    outcome = run_live(
        ScriptedLidar([scan(n) for n in range(6)]),
        flow,
        stop,
        put=put.append,
        on_mapped=lambda _: None,
        release=camera.close,
        camera=camera,
    )
    assert outcome.fault is None
    assert isinstance(outcome.camera_fault, DeviceLostError)
    assert flow.mapper.counters.mapped == 6
    assert sum(isinstance(message, DepthImage) for message in put) == 3, "all that came is recorded"
    assert len([record for record in caplog.records if "end before the run" in record.message]) == 1


class PacedLidar(ScriptedLidar):
    """Yields its messages a turn apart."""

    def __iter__(self):
        for message in self._messages:
            if self._stopped.wait(TURN_S):
                return
            yield message


@pytest.mark.live(cores=1)
def test_a_camera_that_comes_back_is_recorded_on_and_the_lidar_all_the_time(caplog, tmp_path):
    image = np.full((240, 424), 1500, np.uint16)
    emulator = D435Emulator(repeat(image), faults=StreamFaults(unplug_at=12))
    camera = ReconnectingCamera(
        lambda: open_depth_camera(emulator.path, DepthMode(424, 240, 30), calls=emulator), patience_s=np.inf
    )
    depth = DepthFlow(Config(), lambda _: CameraMount(), alone=False, projection=project)
    flow = MappingFlow(Config(), Config().mount(), depth=depth)
    scans = 30
    threading.Timer(1.5, emulator.plug_in).start()  # unplugged since 0.4 s, again from 1.9 s or so on
    recorder = McapRecorder(tmp_path / "r.mcap", metadata={})
    outcome = run_live(
        PacedLidar([scan(n) for n in range(scans)]),  # the run ends with it, however long that takes
        flow,
        threading.Event(),
        put=recorder.put,
        on_mapped=lambda _: None,
        release=camera.close,
        camera=camera,
    )
    written = recorder.close()
    assert outcome.fault is None
    assert isinstance(outcome.camera_fault, DeviceLostError), "lost for the second time when the run ends"
    assert flow.mapper.counters.mapped == scans
    assert (written.error, written.dropped) == (None, {})
    with open_recording(tmp_path / "r.mcap") as recording:
        messages = list(recording.messages(None))
    stamps = [message.stamp_ns for message in messages if isinstance(message, DepthImage)]
    assert len(stamps) == camera.counters.frames == 24
    assert 0.5 < np.diff(stamps).max() * 1e-9 < 2.0
    assert len({message.stamp_ns for message in messages if isinstance(message, LaserScan)}) == scans
    told = [record.message for record in caplog.records]
    assert sum("is lost" in line for line in told) == 2
    assert sum("is back" in line for line in told) == 1
    assert sum("end before the run" in line for line in told) == 1


@pytest.mark.live(cores=1)
def test_a_lost_camera_ends_a_run_that_has_nothing_else():
    camera = camera_that_is_lost(at=3)
    outcome = record_live(None, threading.Event(), put=lambda _: None, camera=camera)
    camera.close()
    assert isinstance(outcome.fault, DeviceLostError)
    assert outcome.camera_fault is None


def test_of_a_camera_alone_the_latest_image_counts():
    camera = Pinhole(4, 3, 4.0, 4.0, 1.5, 1.0)
    images = [DepthImage(n, np.zeros((3, 4), np.uint16), 0.001, camera) for n in range(10)]
    reading = LiveReading(None, ScriptedLidar(images, DeviceLostError("x")), lambda _: None)
    reading.start()
    reading.stop()
    assert [message.stamp_ns for message in reading.take(0.0)] == [9]
    assert reading.outcome().dropped_images == 9
