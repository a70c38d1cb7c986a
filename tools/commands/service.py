"""`mapfuse-robot service`: a systemd unit that maps from the car's start on."""

from __future__ import annotations

import getpass
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import load_config, require_sensor
from tools.commands.run import WithGoals, run, wanted_of
from tools.errors import UsageError

_BEYOND_REGAIN_S = 10


def service(
    context: typer.Context,
    user: Annotated[
        str | None, typer.Option("--user", metavar="NAME", help="Who runs it.  [default: who calls this]")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where it runs and makes its runs/<time>.  [default: the current folder]"),
    ] = None,
    watchdog: Annotated[
        int | None,
        typer.Option(
            min=2,
            max=7200,
            metavar="S",
            help="It is ended, and started again, when no scan is mapped for so long.  [default: 10 s beyond"
            " lidar.regain_s]",
        ),
    ] = None,
    stop_timeout: Annotated[
        int, typer.Option(min=10, max=86400, metavar="S", help="How long it may save and refine at the end.")
    ] = 180,
) -> None:
    """Print a systemd unit for `mapfuse-robot run` with the options that follow, which are those of run.

    To install it: mapfuse-robot service --lidar /dev/lidar | sudo tee /etc/systemd/system/mapfuse-robot.service, then
    sudo systemctl daemon-reload && sudo systemctl enable --now mapfuse-robot. It has started when the first scan is
    mapped; `systemctl status` shows how it stands, `systemctl stop` saves everything. A run that drives (--goal) is
    not started again by itself.
    """
    from tools.service_unit import ServiceUnit

    given = run_options(context.args)
    words = absolute_paths(context.args, given)
    config = load_config(given["config_file"])
    if given.get("output") is not None:
        raise UsageError("-o: a service may start many times, each into a folder of its own: use --folder DIR instead")
    unit = ServiceUnit(
        program=[*own_program(), "run", *words],
        folder=(folder or Path.cwd()).resolve(),
        user=user or getpass.getuser(),
        restarts=not given.get("goal"),
        own_guard=str(given.get("vehicle")).partition(":")[0] == "qcar",
        stop_s=stop_timeout,
        watchdog_s=watchdog or math.ceil(config.lidar.regain_s) + _BEYOND_REGAIN_S,
    )
    if not unit.folder.is_dir():
        raise UsageError(f"--folder {unit.folder}: no such folder: make it")
    typer.echo(unit.text(), nl=False)


def run_options(words: Sequence[str]) -> dict[str, Any]:
    """Return the options of `run` that the words say; raises the parser's errors, and UsageError
    without a sensor or for a drive that makes no sense.
    """
    parser = typer.Typer(add_completion=False)
    parser.command(cls=WithGoals)(run)
    given = typer.main.get_command(parser).make_context("mapfuse-robot run", list(words)).params
    require_sensor(given.get("lidar"), given.get("depth"))
    wanted_of(**{name: given.get(name) for name in ("lidar", "map_file", "goal", "start", "vehicle", "resume")})
    return given


def absolute_paths(words: Sequence[str], given: Mapping[str, object]) -> list[str]:
    """Return the words with their files named by absolute paths: the service runs in a folder of its own."""
    files = {str(value): str(value.resolve()) for value in given.values() if isinstance(value, Path)}
    named = []
    for word in words:
        option, equals, value = word.partition("=")
        named.append(f"{option}={files[value]}" if equals and value in files else files.get(word, word))
    return named


def own_program() -> list[str]:
    """Return how this program is called by an absolute path."""
    script = Path(sys.executable).with_name("mapfuse-robot")
    return [str(script)] if script.exists() else [sys.executable, "-m", "tools.cli"]
