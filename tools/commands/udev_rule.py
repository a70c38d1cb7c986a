"""`mapfuse-robot udev-rule`: a fixed name for the lidar's port."""

from __future__ import annotations

from typing import Annotated

import typer

from tools.errors import UsageError


def udev_rule(
    port: Annotated[
        str | None, typer.Argument(metavar="[PORT]", help="The adapter to name; without it any CP210x is meant.")
    ] = None,
    name: Annotated[str, typer.Option("--name", help="The port will be /dev/NAME.")] = "lidar",
) -> None:
    """Print a udev rule that gives the lidar's USB adapter a fixed name and the group dialout.

    Two adapters of one kind are told apart by their serial numbers, so name the port. To install it:
    mapfuse-robot udev-rule /dev/ttyUSB0 | sudo tee /etc/udev/rules.d/99-lidar.rules, then
    sudo udevadm control --reload && sudo udevadm trigger.
    """
    from drivers import serial_names

    if not name.isidentifier():
        raise UsageError(f"--name {name}: expected a plain word, such as lidar")
    typer.echo(serial_names.udev_rule(port, name))
