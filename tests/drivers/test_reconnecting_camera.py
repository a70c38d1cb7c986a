"""An emulated camera that is unplugged and plugged in again, in simulated time."""

from __future__ import annotations

import logging
import math
from itertools import count, islice

import numpy as np
import pytest

from drivers.d435_emulated_firmware import EmulatedFirmware
from drivers.d435_emulated_stream import StreamFaults
from drivers.d435_emulator import D435Emulator
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.emulated_link import SimulatedClock
from drivers.errors import DeviceFaultError, DeviceLostError, PortMissingError
from drivers.reconnecting_camera import RETRY_S, ReconnectingCamera

AWAY_S = 3.0


class Plug:
    """A camera that vanishes at frame `unplug_at` of each stream and is plugged in again after AWAY_S, or never."""

    def __init__(self, *, unplug_at=5, returns=True, patience_s=math.inf, faults=None, then=lambda _: None):
        self.clock = SimulatedClock(1_000_000_000)
        self.emulator = D435Emulator(
            (np.full((240, 424), number, np.uint16) for number in count()),
            faults=StreamFaults(unplug_at=unplug_at) if faults is None else faults,
            clock=self.clock,
            sleep=self.clock.sleep,
        )
        self.returns = returns
        self.then = then
        self.waited_s = 0.0
        self.camera = ReconnectingCamera(self.open, patience_s=patience_s, clock=self.clock, sleep=self.sleep)

    def open(self):
        return open_depth_camera(self.emulator.path, DepthMode(424, 240, 90), calls=self.emulator)

    def sleep(self, seconds):
        """Between two attempts."""
        self.clock.sleep(seconds)
        self.waited_s += seconds
        if self.returns and self.waited_s >= AWAY_S:
            self.waited_s = 0.0
            self.emulator.plug_in()
        self.then(self)


def test_frames_go_on_after_the_camera_is_back_each_loss_and_return_one_line(caplog):
    plug = Plug()
    with caplog.at_level(logging.INFO), plug.camera as camera:
        images = list(islice(camera, 13))
    assert [int(image.depth[0, 0]) for image in images] == list(range(13))
    stamps = np.array([image.stamp_ns for image in images])
    gaps_s = np.diff(stamps) * 1e-9
    assert (gaps_s > 0).all()
    assert np.flatnonzero(gaps_s > 1.0).tolist() == [4, 9]
    assert gaps_s[[4, 9]] == pytest.approx(AWAY_S, abs=RETRY_S)
    assert (camera.losses, camera.counters.frames, camera.counters.lost_frames) == (2, 13, 0)
    lines = [record.message for record in caplog.records]
    assert ["lost" in line for line in lines] == [True, False, True, False]
    assert all(f"back after {AWAY_S:.1f} s" in line for line in lines[1::2])


def test_a_camera_that_does_not_return_ends_it_with_the_reason():
    plug = Plug(returns=False, patience_s=10.0)
    with (
        plug.camera as camera,
        pytest.raises(DeviceLostError, match=r"went away.*not back after 10 s; at last: .*no such"),
    ):
        list(camera)
    assert camera.counters.frames == 5


def test_a_stop_ends_the_search_and_the_loss_is_told():
    plug = Plug(returns=False, then=lambda plug: plug.camera.request_stop() if plug.waited_s > 2.0 else None)
    with plug.camera as camera, pytest.raises(DeviceLostError, match="not back after 2 s"):
        list(camera)


def test_a_stop_while_it_streams_is_the_usual_end():
    plug = Plug()
    received = []
    with plug.camera as camera:
        for image in camera:
            received.append(image)
            if len(received) == 7:
                camera.request_stop()
    assert len(received) == 7


def test_without_patience_nothing_is_looked_for():
    plug = Plug(patience_s=0.0)
    with plug.camera as camera, pytest.raises(DeviceLostError):
        list(camera)
    assert plug.waited_s == 0.0


def test_another_camera_is_not_taken_for_the_one_that_was_lost():
    def exchange(plug):
        plug.emulator.firmware = EmulatedFirmware(rectification=False)  # an older one

    plug = Plug(patience_s=8.0, then=exchange)
    with plug.camera as camera, pytest.raises(DeviceLostError, match="another camera than before"):
        list(camera)
    assert camera.counters.frames == 5


def test_silence_is_a_loss_too_and_a_new_stream_ends_it():
    plug = Plug(faults=StreamFaults(silent_from=4))
    with plug.camera as camera:
        assert len(list(islice(camera, 10))) == 10
    assert camera.losses == 2


def test_a_camera_that_never_sends_a_frame_is_faulty_not_lost():
    plug = Plug(faults=StreamFaults(silent_from=0))
    with plug.camera as camera, pytest.raises(DeviceFaultError):
        list(camera)


def test_a_camera_that_is_not_there_at_first_is_not_waited_for():
    emulator = D435Emulator(iter(()))
    emulator.unplug()
    with pytest.raises(PortMissingError):
        ReconnectingCamera(lambda: open_depth_camera(emulator.path, calls=emulator), patience_s=math.inf)
