"""`mapfuse-robot udev-rule`: fixed names for what is plugged into a car."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

import typer

from tools.errors import UsageError


class Device(str, Enum):
    """What gets a name, which is its own unless told."""

    lidar = "lidar"
    vehicle = "vehicle"
    camera = "camera"


def udev_rule(
    port: Annotated[
        str | None,
        typer.Argument(metavar="[PORT]", help="The serial adapter to name; without it any of the device's kind."),
    ] = None,
    device: Annotated[
        Device,
        typer.Option(help="The lidar (without PORT any CP210x), the vehicle (PX4, ArduPilot), the camera (D435)."),
    ] = Device.lidar,
    name: Annotated[
        str | None, typer.Option("--name", help="It will be /dev/NAME.  [default: lidar, vehicle or camera]")
    ] = None,
) -> None:
    """Print udev rules that give a sensor or the vehicle a fixed name and a group: dialout, for a camera video.

    Two adapters of one kind are told apart by their serial numbers, so name the port. To install it:
    mapfuse-robot udev-rule /dev/ttyUSB0 | sudo tee /etc/udev/rules.d/99-lidar.rules, then
    sudo udevadm control --reload && sudo udevadm trigger.
    """
    from drivers import depth_discovery, serial_names

    link = name or device.value
    if not link.isidentifier():
        raise UsageError(f"--name {link}: expected a plain word, such as lidar")
    if device == Device.camera:
        if port is not None:
            raise UsageError(f"{port}: a camera has no serial port: leave it out")
        typer.echo(depth_discovery.udev_rules(link))
    elif device == Device.vehicle and port is None:
        typer.echo(serial_names.autopilot_rules(link))
    else:
        typer.echo(serial_names.udev_rule(port, link))
