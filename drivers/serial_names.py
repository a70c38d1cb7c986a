"""Names of serial ports that stay: udev's links by the adapter's serial number, and rules for more."""

from __future__ import annotations

from pathlib import Path

from drivers.errors import PortMissingError
from drivers.serial_link import UsbAdapter, usb_adapter

LINK_FOLDERS = (Path("/dev/serial/by-id"), Path("/dev/serial/by-path"))
# What autopilots call themselves on USB, vendor and product: PX4's boards (any), ArduPilot's firmware.
_AUTOPILOTS = (("26ac", None), ("1209", "5740"), ("1209", "5741"))
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
    return _rule(f"{adapter.vendor:04x}", f"{adapter.product:04x}", adapter.serial_number, name)


def autopilot_rules(name: str) -> str:
    """Rules that give an autopilot of PX4 or ArduPilot on USB the name /dev/`name`: its first port speaks MAVLink."""
    first = 'ENV{ID_USB_INTERFACE_NUM}=="00"'
    return "\n".join(_rule(vendor, product, None, name, first) for vendor, product in _AUTOPILOTS)


def _rule(vendor: str, product: str | None, serial_number: str | None, name: str, *more: str) -> str:
    matches = ['SUBSYSTEM=="tty"', f'ATTRS{{idVendor}}=="{vendor}"']
    if product:
        matches.append(f'ATTRS{{idProduct}}=="{product}"')
    if serial_number:
        matches.append(f'ATTRS{{serial}}=="{serial_number}"')
    # ModemManager, where it runs, would send a new port the commands of a telephone.
    given = ['GROUP="dialout"', 'MODE="0660"', 'ENV{ID_MM_DEVICE_IGNORE}="1"', f'SYMLINK+="{name}"']
    return ", ".join([*matches, *more, *given])
