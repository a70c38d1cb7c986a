"""Names of serial ports that stay: udev's links by the adapter's serial number, and a rule for one more."""

from __future__ import annotations

from pathlib import Path

from drivers.errors import PortMissingError
from drivers.serial_link import UsbAdapter, usb_adapter

LINK_FOLDERS = (Path("/dev/serial/by-id"), Path("/dev/serial/by-path"))
_CP2102 = UsbAdapter(0x10C4, 0xEA60, None)  # the adapter of the RPLIDAR's accessory board


def stable_path(port: str, folders: tuple[Path, ...] = LINK_FOLDERS) -> str:
    """The name by which the port is found again after unplugging: by the adapter's serial number, else by its socket.

    A path that is a link already, a URL, and a port without such a name are returned as they are.
    """
    path = Path(port)
    if "://" in port or path.is_symlink() or not path.exists():
        return port
    for folder in folders:
        for link in sorted(folder.glob("*")):
            if link.resolve() == path.resolve():
                return str(link)
    return port


def udev_rule(port: str | None, name: str) -> str:
    """A rule that gives the adapter at `port`, or any CP210x where None, the name /dev/`name`, for group dialout.

    Raises PortMissingError where no USB adapter is at the port.
    """
    adapter = _CP2102 if port is None else usb_adapter(port)
    if adapter is None:
        raise PortMissingError(
            f"{port}: no USB serial adapter is there, so no rule can name it: plug it in or leave it out"
        )
    matches = [
        'SUBSYSTEM=="tty"',
        f'ATTRS{{idVendor}}=="{adapter.vendor:04x}"',
        f'ATTRS{{idProduct}}=="{adapter.product:04x}"',
    ]
    if adapter.serial_number:
        matches.append(f'ATTRS{{serial}}=="{adapter.serial_number}"')
    return ", ".join([*matches, 'GROUP="dialout"', 'MODE="0660"', f'SYMLINK+="{name}"'])
