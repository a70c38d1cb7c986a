"""`mapfuse-robot wheels`: all that must be carried to a car that has no network."""

from __future__ import annotations

import re
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.errors import UsageError
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.wheel_folder import CarComputer, WheelFolder


class Machine(str, Enum):
    """The processors that there are wheels for."""

    aarch64 = "aarch64"
    x86_64 = "x86_64"


def wheels(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the wheels go: new or empty.")],
    platform: Annotated[Machine, typer.Option(help="The car's processor, as `uname -m`.")] = Machine.aarch64,
    python: Annotated[str, typer.Option(metavar="3.N", help="The car's Python.")] = "3.10",
    glibc: Annotated[str, typer.Option(metavar="2.N", help="The car's C library, as `ldd --version`.")] = "2.31",
    extra: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="An extra to take along: plots, depth; may be repeated.")
    ] = None,
    project: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The checkout, with its constraints.txt.  [default: where this runs from]"),
    ] = None,
) -> None:
    """Gather the wheels for a car without a network, in the tested versions, and tell how to install them there.

    Where the tested version of a package has no wheel for the car, the newest that has one and that this program takes
    is gathered in its place, and named. Exit code 3: something has none at all.
    """
    from tools.results import check_run_folder
    from tools.wheel_folder import CarComputer, build_own_wheel, gather, pins

    computer = CarComputer(platform.value, (3, _minor("--python", python, 3)), _minor("--glibc", glibc, 2))
    checkout = project or Path(__file__).resolve().parents[2]
    constraints = checkout / "constraints.txt"
    if not (constraints.is_file() and (checkout / "pyproject.toml").is_file()):
        raise UsageError(f"{checkout}: no checkout of this program is there (constraints.txt): name one with --project")
    check_run_folder(folder)
    if folder.is_dir() and any(folder.iterdir()):
        raise UsageError(f"{folder}: is not empty: name a new folder, so that nothing old goes along")
    folder.mkdir(parents=True, exist_ok=True)
    extras = extra or []
    own = build_own_wheel(checkout, folder)
    gathered = gather(own, extras, pins(constraints.read_text(encoding="utf-8"), computer), computer, folder)
    _print(gathered, computer, folder, extras)
    raise typer.Exit(ExitCode.PARTIAL if gathered.missing else ExitCode.OK)


def _minor(option: str, text: str, major: int) -> int:
    found = re.fullmatch(rf"{major}\.(\d{{1,2}})", text)
    if found is None:
        raise UsageError(f"{option} {text}: expected {major}.N, such as {major}.31")
    return int(found.group(1))


def _print(gathered: WheelFolder, computer: CarComputer, folder: Path, extras: list[str]) -> None:
    size = sum(file.stat().st_size for file in gathered.wheels.values())
    typer.echo(f"{len(gathered.wheels)} wheels ({size / 1e6:.0f} MB) for {computer}: {folder}")
    for other in gathered.others:
        version = gathered.wheels[other.name].name.split("-")[1]
        typer.echo(f"{other.name} {version} in place of the tested {other.pin}, which has no wheel there")
    for missing in gathered.missing:
        wanted, newest = missing.wanted, missing.newest
        has = f"; {newest} has one, but {wanted.allowed} is asked for" if newest else ""
        typer.echo(f"{wanted.name} {wanted.pin or ''}: no wheel there{has} (needed by {wanted.needed_by})")
    if any(missing.wanted.name.startswith("open3d") for missing in gathered.missing):
        typer.echo("without Open3D numpy projects depth images: leave the extra depth out")
        extras = [name for name in extras if name != "depth"]
    name = f"'mapfuse-robot[{','.join(extras)}]'" if extras else "mapfuse-robot"
    typer.echo(f"on the car: python{computer.version} -m pip install --no-index -f {folder} {name}")
