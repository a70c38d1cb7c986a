"""Experiment 5.4: when to merge two maps that grow, and what merging earlier or by other rules would have done."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.readiness import ReadinessRule
from mapping import se2
from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.finished_rows import FinishedRows, finish_rows
from tools.growing_plots import GrowingPicture, draw_growing
from tools.growing_steps import (
    DEFAULT,
    ENOUGH_FREE_M2,
    ENOUGH_WALL_M,
    WAYS,
    StepOutcome,
    enough_from,
    merged_from,
    outcomes,
    truth_row,
    way_row,
)
from tools.map_data_set import DataSetMap, MapDataSet
from tools.results import Report

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)
RULES: dict[str, tuple[str, ReadinessRule | None]] = {
    "the default method, once it has settled": ("default", ReadinessRule()),
    "the default method, each verdict at once": ("default", None),
    "Algorithm 3 (alpha 0.5, ratio 0.8, 3 px, 5000 trials), once it has settled": ("algorithm3", ReadinessRule()),
    "Algorithm 3 (the same), each verdict at once": ("algorithm3", None),
    "Algorithm 3 with the thesis's settings, each verdict at once": ("thesis", None),
}


def lacks(data: MapDataSet) -> str | None:
    """Return what a set lacks: the maps of two robots for several steps, in frames that are known or of two places."""
    robots = {each.robot for each in data.maps if each.step is not None}
    if len(robots) != 2 or min(len(_versions(data, robot)) for robot in robots) < 2:
        return "it needs the maps of two robots, several steps of each: `data-set --kind growing`"
    if data.kind != "growing" and any(each.pose is None for each in data.maps):
        return "it needs the true poses of the maps"
    return None


def run(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Register the two maps of every step, and return what each rule would have made of it."""
    a, b = (_versions(data, robot) for robot in sorted({each.robot for each in data.maps if each.step is not None}))
    T_a_b = _truth(a[0], b[0])
    files = [(a[min(step, len(a) - 1)].path, b[min(step, len(b) - 1)].path) for step in range(max(len(a), len(b)))]
    ways = [way for way in WAYS if T_a_b is not None or way == DEFAULT]
    rows = _rows(FinishedRows(folder / "steps.jsonl", f"seed {settings.seed}"), files, T_a_b, ways, settings)
    found = {name: outcomes(rows, way, T_a_b, rule) for name, (way, rule) in RULES.items() if way in ways}
    settled = next(iter(found.values()))
    enough = enough_from(rows)
    table = Table(
        "What each rule merges",
        (
            "rule",
            "first merge",
            "delay",
            "steps merged",
            "wrong",
            "withdrawn",
            "error of the merge, m, deg (at the end)",
        ),
        [(name, *_cells(each, enough)) for name, each in found.items()],
        _note(rows, enough),
    )
    caption = f"Two growing maps, {data.name}: inliers, acceptance index, probability and motion at each step."
    picture = GrowingPicture(
        title=f"{data.name} ({'simulated' if data.simulated else 'real data'})",
        rows=rows,
        verdicts={way: [step.right for step in outcomes(rows, way, T_a_b, None)] for way in ways},
        settled=settled,
        enough=enough,
    )
    return Experiment(
        [table],
        [Picture(caption, lambda file: draw_growing(file, picture))],
        {
            "enough_at": None if enough is None else enough + 1,
            "rules": {name: _figures(each) for name, each in found.items()},
            "steps": rows,
        },
        [f"Default method at the last step: {settled[-1].reason}."],
    )


def _rows(
    rows: FinishedRows,
    files: Sequence[tuple[Path, Path]],
    T_a_b: FloatArray | None,
    ways: Sequence[str],
    settings: ExperimentSettings,
) -> list[Report]:
    """Return the rows of all steps: truth, and what each way found."""
    truths = {f"{step} truth": (*pair, T_a_b) for step, pair in enumerate(files, start=1)}
    tries = {f"{step} {way}": (*pair, way, settings.seed) for way in ways for step, pair in enumerate(files, start=1)}
    truth = finish_rows(rows, truth_row, truths, settings.jobs, "what the maps share")
    found = finish_rows(rows, way_row, tries, settings.jobs, "registered")
    return [
        {**truth[f"{step} truth"], **{way: found[f"{step} {way}"] for way in ways}} for step in range(1, len(files) + 1)
    ]


def _versions(data: MapDataSet, robot: str) -> list[DataSetMap]:
    return sorted((each for each in data.maps if each.robot == robot and each.step is not None), key=_step)


def _step(each: DataSetMap) -> int:
    assert each.step is not None
    return each.step


def _truth(a: DataSetMap, b: DataSetMap) -> FloatArray | None:
    """Return the true pose (3,) of b's frame in a's; None for maps of two places."""
    return None if a.pose is None or b.pose is None else se2.between(a.pose, b.pose)


def _cells(steps: Sequence[StepOutcome], enough: int | None) -> tuple[str, ...]:
    first = merged_from(steps)
    last = steps[-1].merged_error
    return (
        "never" if first is None else f"{first + 1}",
        "-" if first is None or enough is None else f"{first - enough:+d}",
        f"{sum(step.merged for step in steps)} of {len(steps)}",
        f"{_wrong(steps)}",
        f"{_withdrawals(steps)}",
        "-" if last is None else f"{last.rms_m:.3f}, {last.rotation_deg:.2f}",
    )


def _figures(steps: Sequence[StepOutcome]) -> Report:
    errors = [step.merged_error for step in steps if step.merged_error is not None]
    first = merged_from(steps)
    return {
        "merged_at": None if first is None else first + 1,
        "merged_steps": sum(step.merged for step in steps),
        "steps": len(steps),
        "accepted_steps": sum(step.accepted for step in steps),
        "wrong_steps": _wrong(steps),
        "withdrawals": _withdrawals(steps),
        "worst_rms_m": max((each.rms_m for each in errors), default=None),
        "worst_deg": max((each.rotation_deg for each in errors), default=None),
        "reasons": [step.reason for step in steps],
    }


def _wrong(steps: Sequence[StepOutcome]) -> int:
    return sum(step.right is False for step in steps)


def _withdrawals(steps: Sequence[StepOutcome]) -> int:
    return sum(before.merged and not after.merged for before, after in itertools.pairwise(steps))


def _note(rows: Sequence[Report], enough: int | None) -> str:
    last = rows[-1]
    note = (
        f"Delay: steps after the first one at which the maps share {ENOUGH_WALL_M:g} m of wall and {ENOUGH_FREE_M2:g} "
        f"m² of free space at the true pose ({'never' if enough is None else f'step {enough + 1}'}). Wrong: steps at "
        "which what is merged is off by more than 0.5 m (rms over the common free space) or 3 deg."
    )
    return f"{note} At the end they share {last['common_wall_m']:.0f} m and {last['common_free_m2']:.0f} m²."
