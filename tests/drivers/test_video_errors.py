from __future__ import annotations

import errno
import os

import pytest

from drivers.errors import (
    DeviceFaultError,
    DeviceLostError,
    DriverError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
)
from drivers.video_errors import open_error, request_error


def system_error(code: int) -> OSError:
    return OSError(code, os.strerror(code))


@pytest.mark.parametrize(
    ("code", "kind", "text"),
    [
        (errno.ENOENT, PortMissingError, "no such camera: plug it in"),
        (errno.ENODEV, PortMissingError, "no such camera: plug it in"),
        (errno.EACCES, PortPermissionError, "join the group video (`sudo usermod -aG video "),
        (errno.EPERM, PortPermissionError, "and log in again"),
        (errno.EBUSY, PortBusyError, "another process holds this camera: end it (`fuser -v /dev/video4`"),
        (errno.EISDIR, DriverError, "expected a node such as /dev/video0"),
    ],
)
def test_why_a_node_stays_shut(code, kind, text):
    error = open_error("/dev/video4", system_error(code))
    assert type(error) is kind
    assert str(error).startswith("/dev/video4: ")
    assert text in str(error)


@pytest.mark.parametrize(
    ("code", "streaming", "kind"),
    [
        (errno.ENODEV, False, DeviceLostError),
        (errno.EBADF, False, DeviceLostError),
        (errno.EIO, True, DeviceLostError),
        (errno.EIO, False, DeviceFaultError),
        (errno.EBUSY, True, PortBusyError),
        (errno.EINVAL, True, DeviceFaultError),
    ],
)
def test_why_a_request_failed(code, streaming, kind):
    error = request_error("/dev/video4", "reading", system_error(code), streaming=streaming)
    assert type(error) is kind
    assert "/dev/video4: " in str(error)
    assert "reading" in str(error)
    assert "\n" not in str(error)
