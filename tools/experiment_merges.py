"""Figure 5.3: one fixed map merged with another one at several resolutions, the occupied cells laid over each other."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fusion.alignment import Alignment
from fusion.certainty import Contribution, fuse
from fusion.evaluation import AlignmentError, alignment_error, common_free_points
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.experiment_runs import paired, true_pose
from tools.map_data_set import DataSetMap, MapDataSet
from tools.merging_methods import METHODS
from tools.merging_plots import MergedPoints, MergePanel, draw_merged_points
from tools.pair_files import RIGHT_DEG, RIGHT_M
from tools.pair_registration import PairRegistration
from tools.results import FloatArray, Report

log = logging.getLogger(__name__)
_COLUMNS = ("r_a", "r_b", "merged", "error, m", "error, deg", "from the merge of equal r, m", "reason")
_NOTE = (
    "Error: against the truth, rms over the common free space. From the merge of equal r: how far the pose brings the "
    "same points of b from where that merge has them (rms), whether accepted or not."
)


@dataclass(frozen=True, slots=True, eq=False)
class Merge:
    """A pair of maps, what was found, and how far that is from the truth; error None without a pose."""

    a: DataSetMap
    b: DataSetMap
    alignment: Alignment
    error: AlignmentError | None

    @property
    def right(self) -> bool:
        """Whether the pose is."""
        return self.error is not None and self.error.rms_m <= RIGHT_M and self.error.rotation_deg <= RIGHT_DEG


def lacks(data: MapDataSet) -> str | None:
    """Return what a set lacks: a part that has maps at two resolutions or more."""
    return None if len(_same_fixed_map(data)) > 1 else "no part at two resolutions or more: make a set of kind parts"


def run(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Merge the finest map of the one part with each map of the other, by each method."""
    pairs = _same_fixed_map(data)
    grids = {each.name: read_map(each.path) for pair in pairs for each in pair}
    folder.mkdir(parents=True, exist_ok=True)
    panels, tables, figures = [], list[Table](), list[Report]()
    for name, method in METHODS.items():
        registration = replace(method.registration, seed=settings.seed)
        registering = PairRegistration(registration, folder / f"{name}.jsonl", settings.jobs, _say)
        found = registering.finish(grids, [(a.name, b.name) for a, b in pairs])
        merges = [_judged(a, b, found[a.name, b.name].alignment, grids) for a, b in pairs]
        apart_m = _from_first(merges, grids)
        rows = [_texts(merge, apart) for merge, apart in zip(merges, apart_m, strict=True)]
        tables.append(Table(method.title, _COLUMNS, rows, "" if tables else _NOTE))
        figures += [_figures(name, merge, apart) for merge, apart in zip(merges, apart_m, strict=True)]
        panels.append(MergePanel(method.title, [_points(merge, grids) for merge in merges]))
    data_kind = "simulated" if data.simulated else "real"
    caption = (
        f"The occupied cells of {len(pairs)} merges with one fixed map, r_a = {pairs[0][0].cells_per_meter:g} cells/m, "
        f"in its frame (figure 5.3), {data_kind} data; a merge that was refused is named, not drawn."
    )
    picture = Picture(caption, partial(draw_merged_points, panels=panels))
    return Experiment(tables, (picture,), {"merges": figures})


def _same_fixed_map(data: MapDataSet) -> list[tuple[DataSetMap, DataSetMap]]:
    """Return the pairs whose first map is the finest one of its part, that of equal resolutions first."""
    pairs = paired(data)
    return [pair for pair in pairs if pair[0].name == pairs[0][0].name]


def _judged(a: DataSetMap, b: DataSetMap, found: Alignment, grids: dict[str, OccupancyGrid]) -> Merge:
    if found.T_a_b is None:
        return Merge(a, b, found, None)
    return Merge(a, b, found, alignment_error(grids[a.name], grids[b.name], found.T_a_b, true_pose(a, b)))


def _from_first(merges: Sequence[Merge], grids: dict[str, OccupancyGrid]) -> list[float | None]:
    """Return how far each merge brings the same points of map b from where the first one has them (rms in m).

    The maps of b share the frame of its part in the truth, of which these points are.
    """
    first = merges[0]
    points = common_free_points(grids[first.a.name], grids[first.b.name], true_pose(first.a, first.b))
    places = [_moved(merge, first.b, points) for merge in merges]
    return [
        None if here is None or places[0] is None else float(np.sqrt(((here - places[0]) ** 2).sum(axis=1).mean()))
        for here in places
    ]


def _moved(merge: Merge, b: DataSetMap, points_b: FloatArray) -> FloatArray | None:
    """Return points (N, 2) of map b's frame where a merge with another map of the same part has them."""
    if merge.alignment.T_a_b is None:
        return None
    return se2.transform_points(se2.compose(merge.alignment.T_a_b, true_pose(merge.b, b)), points_b)


def _points(merge: Merge, grids: dict[str, OccupancyGrid]) -> MergedPoints:
    """Return the occupied cells of the merged map."""
    label = f"r_b = {merge.b.cells_per_meter:g}"
    if not merge.alignment.accepted or merge.alignment.T_a_b is None:
        return MergedPoints(f"{label}: refused", np.empty((0, 2)))
    poses = {merge.a.name: se2.IDENTITY, merge.b.name: merge.alignment.T_a_b}
    merged = fuse({name: Contribution(grids[name], pose) for name, pose in poses.items()}).grid()
    wrong = "" if merge.right else ", WRONG"
    return MergedPoints(f"{label}{wrong}", merged.cell_centers(*np.nonzero(merged.occupied)))


def _texts(merge: Merge, apart_m: float | None) -> list[str]:
    verdict = "no" if not merge.alignment.accepted else "yes" if merge.right else "WRONG"
    error = ["-", "-"] if merge.error is None else [f"{merge.error.rms_m:.3f}", f"{merge.error.rotation_deg:.3f}"]
    apart = "-" if apart_m is None else f"{apart_m:.3f}"
    return [
        f"{merge.a.cells_per_meter:g}",
        f"{merge.b.cells_per_meter:g}",
        verdict,
        *error,
        apart,
        merge.alignment.reason,
    ]


def _figures(method: str, merge: Merge, apart_m: float | None) -> Report:
    pose = merge.alignment.T_a_b
    return {
        "method": method,
        "a": merge.a.name,
        "b": merge.b.name,
        "accepted": merge.alignment.accepted,
        "right": merge.right,
        "T_a_b": None if pose is None else pose.tolist(),
        "error_m": None if merge.error is None else merge.error.rms_m,
        "error_deg": None if merge.error is None else merge.error.rotation_deg,
        "from_first_m": apart_m,
        "inliers": merge.alignment.inliers,
        "acceptance": merge.alignment.acceptance,
        "reason": merge.alignment.reason,
    }


def _say(done: int, count: int) -> None:
    log.info("5.3: %d of %d pairs", done, count)
