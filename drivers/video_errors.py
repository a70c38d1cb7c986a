"""The kernel's error numbers on a video node, as typed errors that say what to do."""

from __future__ import annotations

import errno
import os

from drivers.errors import (
    DeviceFaultError,
    DeviceLostError,
    DriverError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
)

_GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ESHUTDOWN)


def open_error(path: str, error: OSError) -> DriverError:
    """Say why a node stays shut."""
    if error.errno in (errno.ENOENT, *_GONE):
        return PortMissingError(f"{path}: no such camera: plug it in or name another node of /dev/video*")
    if error.errno in (errno.EACCES, errno.EPERM):
        user = os.environ.get("USER", "$USER")
        return PortPermissionError(
            f"{path}: no permission to open it: join the group video (`sudo usermod -aG video {user}`) and log in again"
        )
    if error.errno == errno.EBUSY:
        return PortBusyError(f"{path}: another process holds this camera: end it (`fuser -v {path}` names it)")
    return DriverError(f"{path}: cannot be opened ({error.strerror or error}): expected a node such as /dev/video0")


def request_error(path: str, action: str, error: OSError, *, streaming: bool = False) -> DriverError:
    """Say why a request to an open node failed; action: what was being done, such as "reading".

    During a stream EIO means a lost device as well: the kernel breaks the queue before it takes the node away.
    """
    if error.errno in _GONE or (streaming and error.errno == errno.EIO):
        return DeviceLostError(f"{path}: the camera went away while {action}: check its cable and its USB port")
    if error.errno == errno.EBUSY:
        return PortBusyError(f"{path}: busy ({action}): end the process that uses it (`fuser -v {path}`)")
    reason = os.strerror(error.errno) if error.errno else str(error)
    return DeviceFaultError(f"{path}: refused: {action} ({reason}): unplug the camera and plug it in")
