"""The emulated camera as the kernel's side of the system calls; what the driver makes of it is in test_depth_camera."""

from __future__ import annotations

import errno
import time
from itertools import repeat

import numpy as np
import pytest

from drivers import v4l2
from drivers.d435_emulator import D435Emulator, NodeState
from drivers.depth_camera import DepthMode, open_depth_camera
from drivers.emulated_link import SimulatedClock

IMAGE = np.zeros((480, 848), np.uint16)


@pytest.fixture
def camera():
    clock = SimulatedClock()
    return D435Emulator(repeat(IMAGE), clock=clock, sleep=clock.sleep)


def fails(code, action, *arguments):
    with pytest.raises(OSError, match=r"\[Errno") as raised:
        action(*arguments)
    assert raised.value.errno == code


def ask(camera, descriptor, request, layout, *fields):
    argument = bytearray(layout.pack(*fields))
    camera.ioctl(descriptor, request, argument)
    return layout.unpack(argument)


def buffer(index):
    return (index, v4l2.TYPE_VIDEO_CAPTURE, 0, 0, 0, 0, 0, 0, v4l2.MEMORY_MMAP, 0, 0)


def test_opening_follows_the_state_of_the_node(camera):
    fails(errno.ENOENT, camera.open, "/dev/video7")
    camera.state = NodeState.FORBIDDEN
    fails(errno.EACCES, camera.open, camera.path)
    camera.state = NodeState.MISSING
    fails(errno.ENOENT, camera.open, camera.path)
    camera.plug_in()
    descriptor = camera.open(camera.path)
    fails(errno.EMFILE, camera.open, camera.path)
    camera.close(descriptor)
    fails(errno.EBADF, camera.close, descriptor)
    fails(errno.EBADF, camera.ioctl, descriptor, v4l2.QUERYCAP, bytearray(104))


def test_wrong_requests_have_the_kernel_s_errors(camera):
    descriptor = camera.open(camera.path)
    fails(errno.ENOTTY, camera.ioctl, descriptor, 0xC0085699, bytearray(8))
    for request, layout, fields in (
        (v4l2.ENUM_FMT, v4l2.FORMAT_DESCRIPTION, (1, 1, 0, b"", 0)),
        (v4l2.ENUM_FRAMESIZES, v4l2.FRAME_SIZE, (99, v4l2.Z16, 0, 0, 0)),
        (v4l2.ENUM_FRAMEINTERVALS, v4l2.FRAME_INTERVAL, (0, v4l2.Z16, 5, 5, 0, 0, 0)),
        (v4l2.QUERYBUF, v4l2.BUFFER, buffer(0)),
        (v4l2.QBUF, v4l2.BUFFER, buffer(0)),
        (v4l2.DQBUF, v4l2.BUFFER, buffer(0)),
        (v4l2.STREAMON, v4l2.BUFFER_TYPE, (v4l2.TYPE_VIDEO_CAPTURE,)),
    ):
        fails(errno.EINVAL, ask, camera, descriptor, request, layout, *fields)
    fails(errno.EINVAL, camera.mmap, descriptor, 2 * IMAGE.size, 0)


def test_buffers_belong_to_one_side_at_a_time(camera):
    descriptor = camera.open(camera.path)
    wanted = (2, v4l2.TYPE_VIDEO_CAPTURE, v4l2.MEMORY_MMAP)
    assert ask(camera, descriptor, v4l2.REQBUFS, v4l2.REQUEST_BUFFERS, *wanted)[0] == 2
    second = ask(camera, descriptor, v4l2.QUERYBUF, v4l2.BUFFER, *buffer(1))
    assert second[9:] == (2 * IMAGE.size, 2 * IMAGE.size)
    assert len(camera.mmap(descriptor, second[10], second[9])) == 2 * IMAGE.size
    fails(errno.EINVAL, camera.mmap, descriptor, second[10], 1)
    ask(camera, descriptor, v4l2.QBUF, v4l2.BUFFER, *buffer(1))
    fails(errno.EINVAL, ask, camera, descriptor, v4l2.QBUF, v4l2.BUFFER, *buffer(1))
    change = (v4l2.TYPE_VIDEO_CAPTURE, 640, 480, v4l2.Z16, 1, 0, 0)
    fails(errno.EBUSY, ask, camera, descriptor, v4l2.S_FMT, v4l2.IMAGE_FORMAT, *change)
    ask(camera, descriptor, v4l2.STREAMON, v4l2.BUFFER_TYPE, v4l2.TYPE_VIDEO_CAPTURE)
    fails(errno.EAGAIN, ask, camera, descriptor, v4l2.DQBUF, v4l2.BUFFER, *buffer(0))
    fails(errno.EBUSY, ask, camera, descriptor, v4l2.REQBUFS, v4l2.REQUEST_BUFFERS, *wanted)
    assert camera.wait_readable(descriptor, 1.0)
    assert ask(camera, descriptor, v4l2.DQBUF, v4l2.BUFFER, *buffer(0))[0] == 1


def test_a_node_that_does_not_stream_is_always_readable(camera):
    assert camera.wait_readable(camera.open(camera.path), 1.0)


def test_waiting_lets_as_much_time_pass_as_it_takes(camera):
    with open_depth_camera(camera.path, DepthMode(848, 480, 30), calls=camera) as driver:
        driver.start()
        begun_ns = camera.monotonic_ns()
        assert not camera.wait_readable(1000, 0.02)
        assert camera.monotonic_ns() - begun_ns == pytest.approx(0.02e9, abs=1e6)
        assert camera.wait_readable(1000, 5.0)
        assert camera.monotonic_ns() - begun_ns == pytest.approx(1e9 / 30, abs=1e6)


def test_running_free_a_frame_is_ready_whenever_one_is_asked_for():
    clock = SimulatedClock(5)
    camera = D435Emulator(repeat(IMAGE), free_running=True, clock=clock, sleep=clock.sleep)
    with open_depth_camera(camera.path, calls=camera) as driver:
        for number, image in enumerate(driver):
            assert image.sequence == number
            if number == 50:
                driver.request_stop()
    assert clock() == 5, "no time passed"
    assert camera.overruns == 0


@pytest.mark.live
def test_in_real_time_ninety_frames_come_in_a_second():
    camera = D435Emulator(repeat(IMAGE))
    stamps = []
    with open_depth_camera(camera.path, DepthMode(848, 480, 90), calls=camera) as driver:
        for image in driver:
            stamps.append(image.stamp_ns)
            if len(stamps) == 46:
                break
        ended_ns = time.monotonic_ns()
    assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx((45 + driver.counters.lost_frames) / 90, abs=1e-4)
    assert 0 <= ended_ns - stamps[-1] < 0.5e9
