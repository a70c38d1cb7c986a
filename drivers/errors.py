"""What can go wrong with a device, a link or a recording, as typed errors.

Every text names the thing (port, file), what was found and what to do about it, on one line: the command line prints it
as it stands.
"""


class DriverError(Exception):
    """A device or its link cannot be used; the command line exits with 4."""


class PortMissingError(DriverError):
    """No such port: nothing is plugged in under that name."""


class PortPermissionError(DriverError):
    """The port is there, but this user may not open it."""


class PortBusyError(DriverError):
    """Another process holds the port."""


class WrongDeviceError(DriverError):
    """The device is there and answers, but it is of another kind than was asked for."""


class SilentPortError(DriverError):
    """The port opens and nothing answers on it at any baud rate that was tried."""


class WrongBaudError(DriverError):
    """Bytes arrive, but they make no sense at the baud rate that was asked for."""


class DeviceFaultError(DriverError):
    """The device answers and reports a fault of its own (protection stop, stalled motor, refused command)."""


class MotorStalledError(DeviceFaultError):
    """The sensor answers, but measures nothing: its head does not turn, or not steadily."""


class DeviceLostError(DriverError):
    """The device was there and went away during use (unplugged, silent)."""


class LinkFullError(DeviceLostError):
    """The port is there and takes no more bytes: what was to be sent is lost, at least in part."""


class RecordingError(Exception):
    """A file is not a recording that can be read, or holds nothing of use; the command line exits with 1."""


def yaml_fault(error: Exception) -> str:
    """Return in a few words what is wrong with a YAML file, and where; error: a YAMLError or a ValueError."""
    if isinstance(error, UnicodeDecodeError):
        return "it is no text"
    problem, mark = getattr(error, "problem", None), getattr(error, "problem_mark", None)
    if problem is None or mark is None:
        return " ".join(str(error).split())
    return f"line {mark.line + 1}: {' '.join(problem.split())}"
