"""What an experiment on a map data set is given and gives back: settings, tables, pictures, figures for JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.map_data_set import MapDataSet
from tools.results import Report


@dataclass(frozen=True, slots=True)
class ExperimentSettings:
    """runs: of what is random, such as MSAC; seed: of the first run; jobs: processes at a time."""

    runs: int = 100
    seed: int = 0
    jobs: int = 1


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a title, column heads, rows of as many texts each, and notes on what the columns mean."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A caption, and what draws a PNG into a file."""

    caption: str
    draw: Callable[[Path], None]


@dataclass(frozen=True, slots=True)
class Experiment:
    """The outcome: tables, pictures, remarks of a sentence or two each, and all figures as a JSON object.

    complete: False where a part of it failed, which the remarks name.
    """

    tables: Sequence[Table]
    pictures: Sequence[Picture]
    json: Report
    remarks: Sequence[str] = ()
    complete: bool = True


@dataclass(frozen=True, slots=True)
class ExperimentKind:
    """One of the thesis's experiments: its title, what it needs, and how it is run.

    lacks: what a data set does not have of it, None where it has all. run: gets a folder of its own for finished rows
    (tools.finished_rows) and for files that it makes.
    """

    title: str
    lacks: Callable[[MapDataSet], str | None]
    run: Callable[[MapDataSet, ExperimentSettings, Path], Experiment]
