"""The vehicle that the command line names: none, a QCar, or a MAVLink vehicle at an address.

`qcar:PYTHON` names the interpreter that Quanser's API is installed for, where that is not ours.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.mavlink_address import AddressError, parse_address
from drivers.vehicle import NullVehicle, Vehicle
from tools.errors import UsageError

NONE, QCAR = "none", "qcar"


def vehicle_at(text: str, clock: Callable[[], int]) -> Vehicle:
    """Return the vehicle, not yet connected; clock: returns ns, never steps back. Raises UsageError."""
    if text == NONE:
        return NullVehicle(clock)
    kind, _, python = text.partition(":")
    if kind == QCAR:
        from drivers.qcar_vehicle import QcarSettings, QcarVehicle

        return QcarVehicle(clock, settings=QcarSettings(python=python) if python else None)
    try:
        address = parse_address(text)
    except AddressError as error:
        raise UsageError(f"--vehicle: {error}; or {QCAR}, or {NONE}") from error
    from drivers.mavlink_vehicle import open_mavlink

    return open_mavlink(address, clock)
