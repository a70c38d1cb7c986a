"""Trajectories against ground truth: figures for programs, and a table for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mapping.errors import RelationsError
from mapping.ground_truth import read_truth
from mapping.metrics import DeltaUnit, absolute_trajectory_error, relative_pose_error
from mapping.relations import Relations, relation_errors
from mapping.trajectory import Trajectory, read_tum
from tools.errors import ToolError

Scores = dict[str, Any]  # a JSON object


@dataclass(frozen=True, slots=True)
class Interval:
    """Over which interval the relative pose error is taken."""

    delta: float = 1.0
    unit: DeltaUnit = "m"


def score_trajectories(trajectories: Sequence[Path], truth_file: Path, interval: Interval) -> list[Scores]:
    """Return the scores of each trajectory; the kind of truth is told by its content.

    Raises MappingError and ToolError, which name the file, for one that cannot be read or has nothing in common with
    the truth.
    """
    truth = read_truth(truth_file)
    return [_score(file, truth_file, truth, interval) for file in trajectories]


def _score(file: Path, truth_file: Path, truth: Relations | Trajectory, interval: Interval) -> Scores:
    trajectory = read_tum(file)
    named: Scores = {"trajectory": str(file), "truth": str(truth_file)}
    try:
        if isinstance(truth, Relations):
            return {**named, "metric": "relations", **asdict(relation_errors(trajectory, truth))}
        absolute = absolute_trajectory_error(trajectory, truth)
        relative = relative_pose_error(trajectory, truth, interval.delta, interval.unit)
    except (RelationsError, ValueError) as error:
        raise ToolError(f"{file}: against {truth_file}: {error}") from error
    return {**named, "metric": "trajectory", "ate": asdict(absolute), "rpe": asdict(relative)}


def is_partial(scores: Scores) -> bool:
    """Whether a part of the truth has no pose in the trajectory to compare."""
    return bool(scores["metric"] == "relations" and scores["unmatched"])


def table_of(rows: Sequence[Scores]) -> list[str]:
    """Return lines: two of head, then one a trajectory; all rows are of one metric."""
    columns = _RELATION_COLUMNS if rows[0]["metric"] == "relations" else _trajectory_columns(rows[0])
    cells = [[column.top for column in columns], [column.head for column in columns]]
    cells += [[column.text(row) for column in columns] for row in rows]
    names = ["", "trajectory", *(row["trajectory"] for row in rows)]
    widths = [max(len(line[place]) for line in cells) for place in range(len(columns))]
    name_width = max(map(len, names))
    return [
        "  ".join(
            [name.ljust(name_width), *(cell.rjust(width) for cell, width in zip(line, widths, strict=True))]
        ).rstrip()
        for name, line in zip(names, cells, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Column:
    """One column of the table: two lines of head, and what stands in a row."""

    top: str
    head: str
    text: Callable[[Scores], str]


def _number(digits: int, *keys: str) -> Callable[[Scores], str]:
    """Return what prints the number found under the keys, or - where there is none."""

    def text(scores: Scores) -> str:
        value: object = scores
        for key in keys:
            value = value[key] if isinstance(value, Mapping) else None
        return f"{value:.{digits}f}" if isinstance(value, int | float) else "-"

    return text


_RELATION_COLUMNS = (
    _Column("", "relations", _number(0, "relations")),
    _Column("no", "pose", lambda scores: f"{scores['unmatched_share']:.1%}"),
    _Column("translation", "mean m", _number(4, "mean_m")),
    _Column("", "std", _number(4, "std_m")),
    _Column("", "median", _number(4, "median_m")),
    _Column("", "max", _number(3, "max_m")),
    _Column("rotation", "mean deg", _number(3, "mean_deg")),
    _Column("", "std", _number(3, "std_deg")),
    _Column("", "median", _number(3, "median_deg")),
    _Column("", "max", _number(2, "max_deg")),
    _Column("< 10 s", "relations", _number(0, "short", "relations")),
    _Column("", "mean m", _number(4, "short", "mean_m")),
    _Column("", "mean deg", _number(3, "short", "mean_deg")),
)


def _trajectory_columns(scores: Scores) -> tuple[_Column, ...]:
    relative = scores["rpe"]
    return (
        _Column("", "poses", _number(0, "ate", "poses")),
        _Column("truth", "covered", lambda row: f"{row['ate']['truth_covered']:.1%}"),
        *_spread_columns("ate", "ATE"),
        *_spread_columns("rpe", f"RPE {relative['delta']:g} {relative['delta_unit']}"),
    )


def _spread_columns(key: str, title: str) -> tuple[_Column, ...]:
    return (
        _Column(title, "rms m", _number(4, key, "rms_m")),
        _Column("", "mean", _number(4, key, "mean_m")),
        _Column("", "median", _number(4, key, "median_m")),
        _Column("", "max", _number(3, key, "max_m")),
        _Column("", "mean deg", _number(3, key, "mean_deg")),
        _Column("", "max", _number(2, key, "max_deg")),
    )
