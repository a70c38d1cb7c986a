"""The V4L2 node: against the emulated camera, and what it makes of the kernel's errors."""

from __future__ import annotations

import errno
import os
from itertools import cycle

import numpy as np
import pytest

from drivers import v4l2
from drivers.d435_emulator import D435Emulator, NodeState
from drivers.emulated_link import SimulatedClock
from drivers.errors import (
    DeviceFaultError,
    DeviceLostError,
    DriverError,
    PortBusyError,
    PortPermissionError,
)
from drivers.system_calls import LinuxSystemCalls
from drivers.video_device import VideoDevice, VideoMode

IMAGE = np.arange(424 * 240, dtype=np.uint16).reshape(240, 424)


@pytest.fixture
def camera():
    clock = SimulatedClock(7_000_000_123)
    return D435Emulator(cycle([IMAGE]), clock=clock, sleep=clock.sleep)


@pytest.fixture
def device(camera):
    device = VideoDevice(camera.path, camera)
    yield device
    device.close()


class Failing:
    """The emulated camera, of which one request, or opening it, fails with a number of the kernel's."""

    def __init__(self, camera, code, request=None):
        self._camera, self.code, self.request = camera, code, request

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def open(self, path):
        if self.request is None:
            raise OSError(self.code, os.strerror(self.code))
        return self._camera.open(path)

    def ioctl(self, descriptor, request, argument):
        if request == self.request:
            raise OSError(self.code, os.strerror(self.code))
        self._camera.ioctl(descriptor, request, argument)


def test_a_node_says_who_it_is_and_what_it_offers(device):
    capability = device.capability()
    assert (capability.driver, capability.card) == ("uvcvideo", "Intel(R) RealSense(TM) Depth Ca")
    assert capability.flags == v4l2.CAP_VIDEO_CAPTURE | v4l2.CAP_STREAMING, "of this node, not of the whole camera"
    assert device.formats() == (v4l2.Z16,)
    modes = device.modes(v4l2.Z16)
    assert VideoMode(848, 480, (6, 15, 30, 60, 90)) in modes
    assert VideoMode(848, 100, (100, 300)) in modes
    assert device.modes(v4l2.fourcc("YUYV")) == ()


def test_a_frame_passes_through_a_buffer(device, camera):
    assert device.set_format(424, 240, v4l2.Z16).bytes_per_line == 848
    assert device.set_rate(60, v4l2.Z16) == pytest.approx(60, rel=1e-3)
    device.start()
    assert device.take() is None
    assert device.wait(1.0)
    buffer = device.take()
    assert (buffer.sequence, buffer.bytes_used, buffer.flags) == (0, 2 * 424 * 240, v4l2.TIMESTAMP_MONOTONIC)
    assert buffer.stamp_ns == pytest.approx(7_000_000_123 + 1e9 / 60, abs=1000), "stamps count microseconds"
    assert np.frombuffer(device.content(buffer), "<u2").tolist() == IMAGE.reshape(-1).tolist()
    device.stop()
    device.stop()


def test_four_buffers_wait_and_more_frames_are_lost(device, camera):
    device.set_format(424, 240, v4l2.Z16)
    device.set_rate(30, v4l2.Z16)
    device.start()
    camera.sleep(10.5 / 30)
    taken = [device.take() for _ in range(5)]
    assert [each.sequence for each in taken[:4]] == [0, 1, 2, 3]
    assert taken[4] is None
    assert camera.overruns == 6
    device.queue(taken[0].index)
    assert device.wait(1.0)
    assert device.take().sequence == 10


def test_a_size_that_is_not_offered_is_refused_with_those_that_are(device):
    with pytest.raises(DeviceFaultError, match=r"800x600 is not offered; offered: 1280x720@6/15/30, 848x480@6/15/30"):
        device.set_format(800, 600, v4l2.Z16)


@pytest.mark.parametrize(("width", "height", "fps"), [(848, 480, 45), (1280, 720, 90)])
def test_a_rate_that_is_not_offered_is_refused_with_those_that_are(device, width, height, fps):
    device.set_format(width, height, v4l2.Z16)
    with pytest.raises(DeviceFaultError, match=rf"{fps} Hz at this size is not offered; offered: 1280x720@6/15"):
        device.set_rate(fps, v4l2.Z16)


def test_a_node_that_cannot_set_its_rate_keeps_it(camera):
    device = VideoDevice(camera.path, Failing(camera, errno.ENOTTY, v4l2.S_PARM))
    device.set_format(424, 240, v4l2.Z16)
    assert device.set_rate(30, v4l2.Z16) is None


def test_a_node_that_stays_shut_says_why(camera):
    with pytest.raises(PortPermissionError, match="usermod -aG video"):
        VideoDevice(camera.path, Failing(camera, errno.EACCES))


@pytest.mark.parametrize(
    ("code", "kind"),
    [(errno.ENODEV, DeviceLostError), (errno.EBUSY, PortBusyError), (errno.ENOMEM, DeviceFaultError)],
)
def test_why_streaming_does_not_start_is_typed_and_leaves_no_buffers(camera, code, kind):
    calls = Failing(camera, code, v4l2.STREAMON)
    device = VideoDevice(camera.path, calls)
    with pytest.raises(kind, match="/dev/video0: .*starting the stream"):
        device.start()
    calls.request = 0
    device.set_format(424, 240, v4l2.Z16)  # refused as long as buffers exist
    device.start()
    assert device.wait(1.0)


def test_a_queue_that_the_kernel_breaks_is_a_lost_camera(camera):
    device = VideoDevice(camera.path, Failing(camera, errno.EIO, v4l2.DQBUF))
    device.start()
    with pytest.raises(DeviceLostError, match="went away while reading"):
        device.take()


def test_a_file_that_is_no_video_node_is_refused(tmp_path):
    file = tmp_path / "video0"
    file.touch()
    device = VideoDevice(str(file), LinuxSystemCalls())
    with pytest.raises(DriverError, match="not a video device: name a node such as"):
        device.capability()
    device.close()


def test_after_unplugging_every_request_says_so_and_closing_is_quiet(device, camera):
    device.start()
    camera.unplug()
    assert device.wait(1.0), "poll returns at once with an error"
    for request in (device.take, device.capability, lambda: device.queue(0), lambda: device.read_control(3, 2, 1)):
        with pytest.raises(DeviceLostError, match="check its cable"):
            request()
    device.close()
    device.close()
    with pytest.raises(DeviceLostError, match="is closed"):
        device.take()


def test_busy_means_that_another_process_streams(device, camera):
    camera.state = NodeState.BUSY
    with pytest.raises(PortBusyError, match=r"end the process that uses it \(`fuser -v /dev/video0`\)"):
        device.set_format(848, 480, v4l2.Z16)


def test_controls_are_read_and_written_by_address(device, camera):
    device.write_control(3, 4, (210).to_bytes(2, "little"))
    assert camera.firmware.control(4) == 210
    assert device.read_control(3, 4, 2) == (210).to_bytes(2, "little")
    with pytest.raises(DeviceFaultError, match="control 4 of unit 3"):
        device.read_control(3, 4, 3)
    with pytest.raises(DeviceFaultError, match="control 4 of unit 9"):
        device.read_control(9, 4, 2)
