"""Runs experiments on a map data set and writes each as NAME.md, NAME.json and PNGs, and an index README.md."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from tools.experiment import Experiment, ExperimentKind, ExperimentSettings, Table
from tools.map_data_set import MapDataSet, data_hash
from tools.results import Report, writing_to

_PARTS = "rows"


@dataclass(frozen=True, slots=True)
class Written:
    """What became of one experiment: skipped says why it was not run; again: it was finished by an earlier run."""

    name: str
    title: str
    skipped: str | None = None
    again: bool = False
    complete: bool = True


def run_experiments(
    chosen: Mapping[str, ExperimentKind],
    data: MapDataSet,
    settings: ExperimentSettings,
    folder: Path,
    command: str,
    on_progress: Callable[[str], None],
) -> list[Written]:
    """Run each experiment that the data set has all for, write its files at once, and the index at the end.

    An experiment that an earlier run finished, with the same maps and settings, is not run again. Raises ToolError.
    """
    identity = {
        "settings": {"runs": settings.runs, "seed": settings.seed},
        "version": version("mapfuse-robot"),
        "data": data_hash(data),
    }
    done = []
    for name, kind in chosen.items():
        lacking = kind.lacks(data)
        if lacking is not None:
            on_progress(f"{name}: skipped: {lacking}")
            done.append(Written(name, kind.title, skipped=lacking))
            continue
        earlier = _earlier(folder, name, identity)
        if earlier is None:
            on_progress(f"{name}: {kind.title}")
            outcome = kind.run(data, settings, folder / _PARTS / file_name(name))
            _write(folder, name, kind.title, data, outcome, identity | {"command": command})
            done.append(Written(name, kind.title, complete=outcome.complete))
        else:
            on_progress(f"{name}: finished by an earlier run")
            done.append(Written(name, kind.title, again=True, complete=bool(earlier["complete"])))
    _write_text(folder / "README.md", _index([*done, *_others(folder, done, identity)], data, command))
    return done


def file_name(name: str) -> str:
    """Return the stem of an experiment's files."""
    return name.replace("/", "-")


def table_lines(table: Table) -> list[str]:
    """Return a table as Markdown, columns of equal width."""
    rows = [list(table.columns), *map(list, table.rows)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(table.columns))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return [f"**{table.title}**", "", lines[0], rule, *lines[1:], *(["", table.note] if table.note else [])]


def _earlier(folder: Path, name: str, identity: Report) -> Report | None:
    content = _read(folder / f"{file_name(name)}.json")
    return content if _is_of(content, identity) else None


def _read(path: Path) -> Report:
    """Return the JSON object of a file; an empty one where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _is_of(content: Report, identity: Report) -> bool:
    """Whether a file is of an experiment that was finished with these maps, settings and version."""
    return all(content.get(key) == value for key, value in identity.items()) and isinstance(
        content.get("complete"), bool
    )


def _others(folder: Path, done: Sequence[Written], identity: Report) -> list[Written]:
    """Return what earlier runs with other --only finished there, with the same maps and settings."""
    names = {each.name for each in done}
    found = []
    for path in sorted(folder.glob("*.json")):
        content = _read(path)
        name = str(content.get("experiment"))
        if name not in names and _is_of(content, identity):
            found.append(Written(name, str(content.get("title")), again=True, complete=content["complete"]))
    return found


def _write(folder: Path, name: str, title: str, data: MapDataSet, outcome: Experiment, identity: Report) -> None:
    """Write pictures and Markdown, and at last the JSON, which says that all is there."""
    stem = file_name(name)
    lines = [f"# {name}: {title}", "", _source_line(data)]
    for number, picture in enumerate(outcome.pictures):
        file = folder / (f"{stem}.png" if number == 0 else f"{stem}-{number + 1}.png")
        with writing_to(folder):
            picture.draw(file)
        lines += ["", f"![{picture.caption}]({file.name})", "", picture.caption]
    for table in outcome.tables:
        lines += ["", *table_lines(table)]
    for remark in outcome.remarks:
        lines += ["", remark]
    lines += ["", "```", str(identity["command"]), "```"]
    _write_text(folder / f"{stem}.md", lines)
    content = {
        "experiment": name,
        "title": title,
        "source": data.source,
        "simulated": data.simulated,
        "data_set_command": data.command,
        **identity,
        "complete": outcome.complete,
        "remarks": list(outcome.remarks),
        "tables": [asdict(table) for table in outcome.tables],
        "results": outcome.json,
    }
    _write_text(folder / f"{stem}.json", [json.dumps(content, indent=1)])


def _source_line(data: MapDataSet) -> str:
    """Say which data it is of: in each file, since each may be read alone."""
    made = f" Made by `{data.command}`." if data.command else ""
    label = "Simulated" if data.simulated else "Measured"
    return f"{label} on the map set `{data.name}`. {data.source}{made}"


def _index(done: Sequence[Written], data: MapDataSet, command: str) -> list[str]:
    lines = ["# Experiments of the thesis", "", _source_line(data), "", "```", command, "```", ""]
    for each in done:
        stem = file_name(each.name)
        if each.skipped is None:
            note = "" if each.complete else " (incomplete: see there)"
            lines.append(f"- [{each.name}]({stem}.md): {each.title}{note}")
        else:
            lines.append(f"- {each.name}: {each.title}: skipped: {each.skipped}")
    return lines


def _write_text(path: Path, lines: Sequence[str]) -> None:
    partial = path.with_name(f"{path.name}.part")
    with writing_to(path):
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
        partial.replace(path)
