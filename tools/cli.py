"""The command line `mapfuse-robot`: its commands, and the one place where errors become exit codes."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from importlib.metadata import version
from typing import Annotated, NoReturn

import typer

from drivers.errors import DriverError, RecordingError
from fusion.errors import FusionError
from mapping.errors import MappingError
from planning.errors import PlanningError
from tools.commands import (
    align,
    bag,
    bench,
    bench_depth,
    bench_fusion,
    bench_lidar,
    bench_plan,
    bench_slam,
    config,
    data_set,
    demo,
    doctor,
    emulate,
    evaluate,
    evaluate_camera,
    evaluate_drives,
    evaluate_exploring,
    evaluate_features,
    evaluate_fusion,
    evaluate_lidar,
    evaluate_localisation,
    evaluate_plans,
    evaluate_rates,
    evaluate_registration,
    evaluate_relocalisation,
    evaluate_robustness,
    fuse,
    learn,
    pairs,
    plan,
    record,
    replay,
    run,
    service,
    udev_rule,
    wheels,
)
from tools.errors import ToolError, UsageError
from tools.exit_codes import ExitCode

_NAME = "mapfuse-robot"
_PARSER_ERROR: type[typer.BadParameter] = typer.BadParameter.__mro__[1]  # the base of all: typer names only this one

app = typer.Typer(
    name=_NAME,
    help="Maps a building with the lidars of small cars, live or from recordings, joins their maps and plans on them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("run", cls=run.WithGoals)(run.run)
app.command("replay")(replay.replay)
app.command("record")(record.record)
app.command("align")(align.align)
app.command("fuse")(fuse.fuse)
app.command("plan")(plan.plan)
app.command("pairs")(pairs.pairs)
app.command("data-set")(data_set.data_set)
app.command("learn")(learn.learn)
app.command("demo")(demo.demo)
app.command("doctor")(doctor.doctor)
app.command("service", context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(service.service)
app.command("udev-rule")(udev_rule.udev_rule)
app.command("wheels")(wheels.wheels)
app.add_typer(bench.app, name="bench")
bench.app.command("depth")(bench_depth.depth)
bench.app.command("slam")(bench_slam.slam)
bench.app.command("fusion")(bench_fusion.fusion)
bench.app.command("lidar")(bench_lidar.lidar)
bench.app.command("plan")(bench_plan.plan)
app.add_typer(emulate.app, name="emulate")
app.add_typer(bag.app, name="bag")
app.add_typer(evaluate.app, name="evaluate")
evaluate.app.command("camera")(evaluate_camera.camera)
evaluate.app.command("drives")(evaluate_drives.drives)
evaluate.app.command("exploring")(evaluate_exploring.exploring)
evaluate.app.command("localisation")(evaluate_localisation.localisation)
evaluate.app.command("features")(evaluate_features.features)
evaluate.app.command("fusion")(evaluate_fusion.fusion)
evaluate.app.command("lidar")(evaluate_lidar.lidar)
evaluate.app.command("plans")(evaluate_plans.plans)
evaluate.app.command("robustness")(evaluate_robustness.robustness)
evaluate.app.command("registration")(evaluate_registration.registration)
evaluate.app.command("rates")(evaluate_rates.rates)
evaluate.app.command("relocalisation")(evaluate_relocalisation.relocalisation)
app.add_typer(config.app, name="config")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"mapfuse-robot {version('mapfuse-robot')}")
        raise typer.Exit


@app.callback()
def options(
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only warnings and errors on stderr.")] = False,
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of all commands."""
    logging.basicConfig(
        level=logging.WARNING if quiet else logging.INFO, format="%(message)s", stream=sys.stderr, force=True
    )


def main() -> None:
    """Run the command line and exit: a known error becomes one line on stderr, an unknown one a traceback."""
    try:
        try:
            code = app(prog_name=_NAME, standalone_mode=False)
        finally:
            sys.stdout.flush()
    except _PARSER_ERROR as error:
        _refuse_words(error)
    except typer.Abort:
        _fail("given up", ExitCode.FAILED)
    except DriverError as error:
        _fail(error, ExitCode.DEVICE)
    except UsageError as error:
        _fail(error, ExitCode.USAGE)
    except (RecordingError, MappingError, FusionError, PlanningError, ToolError) as error:
        _fail(error, ExitCode.FAILED)
    except OSError as error:
        _fail(_refused_by_system(error), ExitCode.FAILED)
    if code == ExitCode.CUT_OFF:
        _fail("interrupted", ExitCode.CUT_OFF)
    sys.exit(code or ExitCode.OK)


def _refuse_words(error: typer.BadParameter) -> NoReturn:
    """Exit for words that are no command, option or value of one; a group alone shows its help."""
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        sys.exit(ExitCode.USAGE)
    words = " ".join(error.format_message().split()).rstrip(".")
    command = _NAME if error.ctx is None else error.ctx.command_path
    _fail(f"{words}: see {command} -h", ExitCode.USAGE)


def _refused_by_system(error: OSError) -> str:
    """Return the line for what the operating system refused and no layer has a text for: odd names, full disks."""
    if error.filename is not None:
        return f"{error.filename}: {error.strerror}: check the name, the folder and the disk"
    # What is still buffered for a full stdout would fail once more at the end of the process.
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return f"{error.strerror or error}: check where the output goes"


def _fail(error: object, code: ExitCode) -> NoReturn:
    """Print the error as one line and exit."""
    typer.echo(f"{_NAME}: {error}", err=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
