"""The real system calls, on files and pipes: no camera is needed to see that they pass on what they are given."""

from __future__ import annotations

import errno
import os
import sys
import time

import pytest

from drivers.errors import DriverError
from drivers.system_calls import LinuxSystemCalls

FIONREAD = 0x541B  # how many bytes wait in a pipe


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


def test_an_answer_replaces_the_argument(pipe):
    reading, writing = pipe
    os.write(writing, b"five!")
    argument = bytearray(4)
    LinuxSystemCalls().ioctl(reading, FIONREAD, argument)
    assert int.from_bytes(argument, sys.byteorder) == 5


def test_a_request_that_the_file_does_not_know_is_an_error_with_its_number(pipe):
    with pytest.raises(OSError, match="ioctl") as raised:
        LinuxSystemCalls().ioctl(pipe[0], 0x80685600, bytearray(104))
    assert raised.value.errno in (errno.ENOTTY, errno.EINVAL)


def test_waiting_ends_with_data_or_with_the_time(pipe):
    reading, writing = pipe
    calls = LinuxSystemCalls()
    begun_ns = calls.monotonic_ns()
    assert not calls.wait_readable(reading, 0.02)
    assert calls.monotonic_ns() - begun_ns >= 0.019e9
    os.write(writing, b"x")
    assert calls.wait_readable(reading, 10.0)


def test_memory_is_shared_with_the_file(tmp_path):
    file = tmp_path / "buffer"
    file.write_bytes(bytes(8192))
    calls = LinuxSystemCalls()
    descriptor = calls.open(str(file))
    memory = calls.mmap(descriptor, 4096, 4096)
    memory[:4] = b"seen"
    memory.close()
    calls.close(descriptor)
    assert file.read_bytes()[4096:4100] == b"seen"


def test_a_missing_file_says_so():
    with pytest.raises(FileNotFoundError):
        LinuxSystemCalls().open("/dev/no-such-video")


def test_the_clock_is_that_of_the_buffers():
    before = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    assert 0 <= LinuxSystemCalls().monotonic_ns() - before < 1e9


def test_other_systems_are_refused_in_one_line(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(DriverError, match="cameras need 64-bit Linux, this is win32"):
        LinuxSystemCalls()
