"""`mapfuse-robot emulate`: devices in software, on the addresses that real ones would have."""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json
from tools.errors import UsageError


class Tour(str, Enum):
    """The drives through the built-in worlds: a round trip in the office, and one in either wing of `wings`."""

    office = "office"
    west = "wings-west"
    east = "wings-east"


class Wiring(str, Enum):
    """How the emulated lidar is connected."""

    board = "board"
    bare = "bare"


app = typer.Typer(help="Emulate a device.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def devices() -> None:
    """Emulate a device."""


@app.command()
def lidar(
    model: Annotated[str, typer.Option(help="A2M4, A2M6, A2M8 (115200 baud) or A2M12 (256000 baud).")] = "A2M8",
    world: Annotated[
        str | None,
        typer.Option(
            metavar="MAP", help="A map's YAML file, 'office' or 'wings'; else that of the drive, or the office."
        ),
    ] = None,
    pose: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y YAW", help="Stand here: pose of the car in the world, in m and rad."),
    ] = None,
    tour: Annotated[
        Tour, typer.Option("--drive", help="Which way through a built-in world, without --pose and --trajectory.")
    ] = Tour.office,
    trajectory: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Drive along these poses (TUM), from the first scan request on."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true drive (TUM, wall-clock stamps) at the end.")
    ] = None,
    link: Annotated[Path | None, typer.Option(metavar="PATH", help="Make this a symbolic link to the port.")] = None,
    car: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Say here where the car is, for its camera: `run --depth emulated:FILE`."),
    ] = None,
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="Range noise and missing returns.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise and of the faults.")] = 0,
    wiring: Annotated[
        Wiring, typer.Option(help="With the USB accessory board, which drives the motor, or on a bare UART.")
    ] = Wiring.board,
    firmware: Annotated[
        str | None,
        typer.Option(metavar="MAJOR.MINOR", help="Another firmware; before 1.24 it has the two legacy modes alone."),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND[=VALUE][@START[+S]]",
            help="What goes wrong, such as flip=0.002, silence@5+2 or unplug@10+3; may be repeated.",
        ),
    ] = None,
    fault_file: Annotated[
        Path | None, typer.Option("--faults", metavar="FILE", help="A script of faults, one a line; # for comments.")
    ] = None,
    as_json: Json = False,
) -> None:
    """An RPLIDAR A2 on a pseudo-terminal, in a car that drives through a world; serves until Ctrl-C.

    Without --pose and --trajectory it drives through the office. The car sets out a second after the
    first sample is asked for. One line for each event goes to stdout, the port's path first. Faults: flip, drop, chunk,
    latency, stall, silence, unplug, motor-stall, health, slow, mute, banner, reboot, jitter, drift, invalid, noise; see
    docs/lidar-emulator.md.
    """
    from drivers.rplidar_models import MODELS
    from tools.emulation import (
        Drive,
        EmulatedSensor,
        car_writer,
        read_faults,
        serve_lidar,
        simulated_lidar,
        with_firmware,
    )
    from tools.results import check_new_file
    from tools.signals import stop_on_signals
    from tools.world import TOURS

    if model not in MODELS:
        raise UsageError(f"--model {model}: unknown, choose one of {', '.join(MODELS)}")
    emulated = with_firmware(MODELS[model], firmware)
    script = read_faults(fault or [], fault_file, seed)
    if pose is not None and trajectory is not None:
        raise UsageError("--pose and --trajectory exclude each other: give one")
    if pose is not None and not all(math.isfinite(value) for value in pose):
        raise UsageError(f"--pose {pose[0]:g} {pose[1]:g} {pose[2]:g}: expected finite x and y in m and yaw in rad")
    for file in (truth, car):
        if file is not None:
            check_new_file(file)
    toured, _ = TOURS[tour.value] if pose is None and trajectory is None else ("office", ())
    if world not in {None, toured} and pose is None and trajectory is None:
        raise UsageError(f"--world {world}: say where the car is in it, with --pose or --trajectory")
    drive = (
        Drive.standing(pose)
        if pose is not None
        else Drive.from_file(trajectory)
        if trajectory
        else Drive.tour(tour.value)
    )
    ranger = simulated_lidar(world or toured, drive, noise=noise, seed=seed)
    with stop_on_signals() as stop:
        share = car_writer(car, world or toured, drive)
        sensor = EmulatedSensor(emulated, ranger, board=wiring == Wiring.board, script=script, link=link)
        serve_lidar(sensor, ranger, drive, stop, truth=truth, as_json=as_json, car=share)


@app.command()
def rover(
    to: Annotated[
        str,
        typer.Option(
            "--to", metavar="ADDRESS", help="udpout:HOST:PORT sends there, udp:HOST:PORT waits to be spoken to."
        ),
    ] = "udpout:127.0.0.1:14550",
    serial: Annotated[bool, typer.Option("--serial", help="On a pseudo-terminal instead.")] = False,
    link: Annotated[
        Path | None, typer.Option(metavar="PATH", help="With --serial: make this a symbolic link to the port.")
    ] = None,
    pose: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y YAW", help="Where it stands at first, in m and rad.")
    ] = (0.0, 0.0, 0.0),
    timeout_s: Annotated[
        float | None,
        typer.Option("--timeout", metavar="S", min=0.1, help="It stops so long after a setpoint; else 3 s."),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND[=VALUE][@START[+S]]", help="What goes wrong, such as silence@5+2; may be repeated."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true drive (TUM, wall-clock stamps) at the end.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the odometry's noise.")] = 0,
    as_json: Json = False,
) -> None:
    """A MAVLink vehicle, as an ArduRover behaves, on UDP or a pseudo-terminal; serves until Ctrl-C.

    It begins in MANUAL and disarmed, with a QCar's size and limits; no walls stop it. Faults: silence, deaf, cut,
    refuse-arm, mode, disarm; see docs/vehicle.md.
    """
    from tools.results import check_new_file
    from tools.rover_emulation import make_rover, network_address, serve_rover
    from tools.signals import stop_on_signals

    if not all(math.isfinite(value) for value in pose):
        raise UsageError(f"--pose {pose[0]:g} {pose[1]:g} {pose[2]:g}: expected finite x and y in m and yaw in rad")
    if link is not None and not serial:
        raise UsageError("--link: needs --serial")
    if truth is not None:
        check_new_file(truth)
    address = None if serial else network_address(to)
    vehicle = make_rover(pose, fault or [], timeout_s, seed)
    with stop_on_signals() as stop:
        serve_rover(vehicle, address, stop, serial_link=link, truth=truth, as_json=as_json)


@app.command()
def car(
    pose: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y YAW", help="Where it stands at first, in m and rad.")
    ],
    world: Annotated[str, typer.Option(metavar="MAP", help="A map's YAML file, 'office' or 'wings'.")] = "office",
    rover_at: Annotated[
        str,
        typer.Option(
            "--rover",
            metavar="ADDRESS",
            help="udpout:HOST:PORT sends there, udp:HOST:PORT waits to be spoken to, serial:PATH makes a port.",
        ),
    ] = "udpout:127.0.0.1:14550",
    lidar_link: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Make this a symbolic link to the lidar's port.")
    ] = None,
    model: Annotated[str, typer.Option(help="The lidar: A2M4, A2M6, A2M8 (115200 baud) or A2M12 (256000).")] = "A2M8",
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="Range noise and missing returns.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise, odometry and faults.")] = 0,
    timeout_s: Annotated[
        float | None,
        typer.Option("--timeout", metavar="S", min=0.1, help="It stops so long after a setpoint; else 3 s."),
    ] = None,
    lidar_fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND[=VALUE][@START[+S]]", help="As --fault of `emulate lidar`; may be repeated."),
    ] = None,
    rover_fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND[=VALUE][@START[+S]]", help="As --fault of `emulate rover`; may be repeated."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the true drive (TUM, wall-clock stamps) at the end.")
    ] = None,
    as_json: Json = False,
) -> None:
    """A whole car: an RPLIDAR A2 and a MAVLink vehicle that drives through a world, in real time; serves until Ctrl-C.

    The lidar sees the world from where the vehicle's setpoints have brought the car. A wall stops the car, and is
    announced as a contact. Where the computer is too busy, the whole car waits. See docs/vehicle.md.
    """
    from drivers.rplidar_models import MODELS
    from tools.car_emulation import CarWanted, EmulatedVehicle, rover_address, serve_car
    from tools.emulation import read_faults
    from tools.results import check_new_file
    from tools.signals import stop_on_signals

    if model not in MODELS:
        raise UsageError(f"--model {model}: unknown, choose one of {', '.join(MODELS)}")
    if not all(math.isfinite(value) for value in pose):
        raise UsageError(f"--pose {pose[0]:g} {pose[1]:g} {pose[2]:g}: expected finite x and y in m and yaw in rad")
    address, script = rover_address(rover_at), read_faults(lidar_fault or [], None, seed)
    if truth is not None:
        check_new_file(truth)
    wanted = CarWanted(
        world, pose, MODELS[model], lidar_link, script, tuple(rover_fault or ()), timeout_s, noisy=noise, seed=seed
    )
    with stop_on_signals() as stop:
        serve_car(EmulatedVehicle(wanted), address, stop, truth=truth, as_json=as_json)
