"""`mapfuse-robot bag`: look into recordings, check, repair and convert them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from drivers.wording import counted
from tools.commands.options import (
    METRES_PER_COUNT,
    DepthUnit,
    Intrinsics,
    Json,
    RecordingPath,
    print_json,
    refuse_folder_options,
)
from tools.exit_codes import ExitCode

app = typer.Typer(
    help="Look into recordings, check, repair and convert them.", no_args_is_help=True, rich_markup_mode=None
)


_MOST_NAMED = 8


@app.command()
def info(recording: RecordingPath, intrinsics: Intrinsics = None, as_json: Json = False) -> None:
    """List topics, types and counts. Exit code 3: the recording is damaged, and this is what can be read.

    Of MCAP and ROS 2 bags the index is read, of others everything; `bag check` verifies those as well.
    """
    from drivers.recording_reader import open_recording, read_through

    refuse_folder_options(recording, intrinsics)
    with open_recording(recording, intrinsics=intrinsics) as opened:
        read_through(opened)
        values: dict[str, object] = {
            "file": str(recording),
            "duration_s": round((opened.end_ns - opened.start_ns) * 1e-9, 3),
            "start_ns": opened.start_ns,
            "messages": sum(topic.count for topic in opened.topics),
            "simulated": opened.metadata.get("mapfuse.origin", {}).get("simulated") == "true",
            "truncated": opened.truncated,
            "problems": opened.problems,
            "topics": [
                {"name": topic.name, "type": topic.type, "count": topic.count, "read_here": topic.decoded}
                for topic in opened.topics
            ],
        }
        topics = opened.topics
    if as_json:
        print_json(values)
    else:
        label = "  SIMULATED" if values["simulated"] else ""
        typer.echo(
            f"{recording}  {values['duration_s']} s  {counted(sum(topic.count for topic in topics), 'message')}{label}"
        )
        width = max((len(topic.name) for topic in topics), default=0)
        kind_width = max((len(topic.type) for topic in topics), default=0)
        for topic in topics:
            note = "" if topic.decoded else "  not read by replay"
            typer.echo(f"  {topic.name:<{width}}  {topic.type:<{kind_width}}  {topic.count:>8}{note}")
        _echo_lines("damaged", opened.problems)
    raise typer.Exit(ExitCode.PARTIAL if values["truncated"] or values["problems"] else ExitCode.OK)


@app.command()
def check(recording: RecordingPath, intrinsics: Intrinsics = None, as_json: Json = False) -> None:
    """Verify checksums, index, order of time and that messages decode. Exit code 3: there is damage.

    Formats without checksums are read from end to end.
    """
    from drivers.recording_recovery import check as check_recording

    refuse_folder_options(recording, intrinsics)
    report = check_recording(recording, intrinsics=intrinsics)
    if as_json:
        print_json({"ok": report.ok, "problems": list(report.problems), "notes": list(report.notes)})
    else:
        _echo_lines("damaged", report.problems)
        _echo_lines("note", report.notes)
        rescue = "recover" if recording.suffix == ".mcap" else "convert"
        typer.echo(f"{recording}: {'ok' if report.ok else f'damaged: `bag {rescue}` saves what can be read'}")
    raise typer.Exit(ExitCode.OK if report.ok else ExitCode.PARTIAL)


@app.command()
def recover(
    recording: Annotated[Path, typer.Argument(metavar="FILE", help="A damaged or unfinished MCAP file.")],
    destination: Annotated[Path, typer.Argument(metavar="NEW", help="The file to write; never overwritten.")],
    as_json: Json = False,
) -> None:
    """Copy all that can be read to a new, whole file. Exit code 3: some of it was lost."""
    from drivers.recording_recovery import recover as recover_recording

    report = recover_recording(recording, destination)
    if as_json:
        print_json(
            {
                "messages": report.messages,
                "topics": dict(report.topics),
                "lost_bytes": report.lost_bytes,
                "problems": list(report.problems),
            }
        )
    else:
        _echo_lines("damaged", report.problems)
        typer.echo(f"{destination}: {counted(report.messages, 'message')} saved, {report.lost_bytes} bytes lost")
    raise typer.Exit(ExitCode.PARTIAL if report.lost_bytes or report.problems else ExitCode.OK)


@app.command()
def convert(
    recording: RecordingPath,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT.mcap", help="The file to write; never overwritten.")
    ],
    intrinsics: Intrinsics = None,
    depth_unit: DepthUnit = None,
    as_json: Json = False,
) -> None:
    """Turn a recording into one MCAP file. Exit code 3: the input is damaged, and this is what could be read."""
    from drivers.recording_conversion import convert as convert_recording
    from drivers.recording_reader import open_recording

    refuse_folder_options(recording, intrinsics, depth_unit)
    with open_recording(recording, intrinsics=intrinsics, depth_unit_m=depth_unit or METRES_PER_COUNT) as opened:
        report = convert_recording(opened, output)
        damaged = opened.truncated or bool(report.problems)
    if as_json:
        print_json(
            {
                "file": str(output),
                "messages": report.messages,
                "topics": dict(report.topics),
                "left_out": dict(report.left_out),
                "problems": list(report.problems),
            }
        )
    else:
        _echo_lines("damaged", report.problems)
        _echo_lines("left out", [f"{count} {name}" for name, count in report.left_out.items()])
        topics = ", ".join(sorted(report.topics))
        if len(report.topics) > _MOST_NAMED:
            topics = f"{len(report.topics)} topics, which `bag info` lists"
        typer.echo(f"{output}: {counted(report.messages, 'message')} on {topics}")
    raise typer.Exit(ExitCode.PARTIAL if damaged else ExitCode.OK)


def _echo_lines(label: str, lines: tuple[str, ...] | list[str]) -> None:
    """Print one labelled line for each text."""
    for line in lines:
        typer.echo(f"  {label}: {line}")
