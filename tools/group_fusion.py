"""`fuse`: any number of map files in, one global map for each group that hangs together out."""

from __future__ import annotations

import itertools
import json
import logging
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fusion.alignment import Alignment
from fusion.certainty import CertaintyGrid
from fusion.hierarchy import LevelMap, best_pairs, first_level, next_level, tree_lines
from fusion.map_graph import Structure
from fusion.map_set import MapSet
from fusion.registration import register
from mapping.map_io import write_map
from tools.map_alignment import certainty_fields
from tools.map_files import MapFiles, read_maps
from tools.map_folder import expanded
from tools.map_looks import with_looks
from tools.pair_registration import Pair, PairRegistration, Registration
from tools.pictures import draw_map, write_picture
from tools.progress_line import ProgressLine
from tools.result_folder import FUSED, check_result_folder, new_results
from tools.results import FloatArray, Report, new_run_folder, writing_to

log = logging.getLogger(__name__)
CACHE_NAME = "pairs.jsonl"
_GLOBAL = re.compile(r"global_(\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class GlobalMap:
    """A group's evidence, and for each of its maps the pose of its frame (3,) and the covariance (3, 3) of that."""

    cells: CertaintyGrid
    T_global_map: Mapping[str, FloatArray]
    covariance: Mapping[str, FloatArray | None]


@dataclass(frozen=True, slots=True, eq=False)
class FusedGroups:
    """The global maps, the one with the best reference first; registrations that count; what was withdrawn, and why.

    details: more for the report.
    """

    groups: Sequence[GlobalMap]
    alignments: Mapping[Pair, tuple[Alignment, float]]
    withdrawn: Mapping[Pair, str] = field(default_factory=dict)
    details: Report = field(default_factory=dict)


def fuse_maps(
    arguments: Sequence[Path], output: Path | None, registration: Registration, jobs: int = 1
) -> tuple[Path, Report]:
    """Fuse map files, or folders of them, into a folder, global_<k>.yaml/.pgm/.npz/.png and report.json; return both.

    Maps that do not belong together become a global map each; one that cannot be read or knows nothing is skipped, if
    another can be used. Finished registrations are kept in the folder, so that a run that was interrupted goes on. The
    order of the files changes nothing but the order in the report. Raises MapFileError, ToolError and UsageError.
    """
    files = expanded(arguments)
    check_result_folder(output, FUSED, [*arguments, *files])
    started = time.perf_counter()
    loaded = read_maps(files)
    folder = new_run_folder(output)
    cache = folder / CACHE_NAME if len(loaded.maps) > 1 else None
    with ProgressLine("registered {done} of {count} pairs") as progress:
        pairs = PairRegistration(registration, cache, jobs, progress.tell)
        fused = _in_levels(loaded, pairs) if registration.method == "thesis" else _by_graph(loaded, pairs, jobs)
    report = fusion_report(loaded, fused, registration, pairs)
    report["seconds"] = round(time.perf_counter() - started, 3)
    new_results(folder, FUSED)
    save_fusion(folder, fused.groups, report)
    return folder, report


def fusion_report(loaded: MapFiles, fused: FusedGroups, registration: Registration, pairs: PairRegistration) -> Report:
    """Return what report.json holds, without the time that it took."""
    count = len(loaded.maps)
    return {
        "maps": [_map_entry(loaded, number, fused.groups) for number in range(len(loaded.files))],
        "pairs": _pair_entries(loaded, fused, registration),
        "groups": [_group_entry(loaded, k, group) for k, group in enumerate(fused.groups)],
        **fused.details,
        "registrations": {
            "registered": pairs.registered,
            "from_cache": pairs.taken,
            "all_pairs": count * (count - 1) // 2,
            "process_seconds": round(pairs.seconds, 3),
        },
        "method": registration.method,
        "settings": registration.settings_report(),
        "seed": registration.seed,
    }


def global_maps(maps: MapSet, structure: Structure) -> list[GlobalMap]:
    """Return the global map of each group of a structure."""
    return [
        GlobalMap(
            maps.fused(group),
            {name: each.T_group_map for name, each in group.maps.items()},
            {name: each.covariance for name, each in group.maps.items()},
        )
        for group in structure.groups
    ]


def _by_graph(loaded: MapFiles, pairs: PairRegistration, jobs: int) -> FusedGroups:
    """Register what retrieval names, and return what hangs together."""
    maps, seconds = with_looks(MapSet(), loaded.maps, jobs).added(loaded.maps), dict[Pair, float]()
    while missing := maps.missing():
        log.info("%d maps: %d pairs to register", len(maps.maps), len(missing))
        finished = pairs.finish(maps.maps, missing)
        maps = maps.registered({pair: each.alignment for pair, each in finished.items()})
        seconds |= {pair: each.seconds for pair, each in finished.items()}
    structure = maps.structure(loaded.titles())
    withdrawn = {each.pair: each.reason for each in structure.withdrawn}
    for (a, b), reason in withdrawn.items():
        log.warning("%s with %s: withdrawn: %s", loaded.title(a), loaded.title(b), reason)
    alignments = {pair: (maps.alignments[pair], seconds[pair]) for pair in maps.pairs()}
    return FusedGroups(global_maps(maps, structure), alignments, withdrawn)


def _in_levels(loaded: MapFiles, pairs: PairRegistration) -> FusedGroups:
    """Merge the best pairs of each level, as the thesis does, until none is accepted any more."""
    level = first_level(loaded.maps)
    titles = loaded.titles()
    first: dict[Pair, tuple[Alignment, float]] = {}
    levels: list[Report] = []
    while len(level) > 1:
        grids = {each.name: each.grid for each in level}
        log.info("level %d: %d maps", len(levels) + 1, len(level))
        finished = pairs.finish(grids, list(itertools.combinations(grids, 2)))
        alignments = {pair: each.alignment for pair, each in finished.items()}
        first = first or {pair: (each.alignment, each.seconds) for pair, each in finished.items()}
        merged = best_pairs(alignments)
        if not merged:
            break
        levels.append(
            {
                "level": len(levels) + 1,
                "merged": [
                    {
                        "a": _titles(a, level, titles),
                        "b": _titles(b, level, titles),
                        "inliers": alignments[a, b].inliers,
                        "acceptance": round(alignments[a, b].acceptance, 4),
                    }
                    for a, b in merged
                ],
            }
        )
        level = next_level(level, alignments)
    groups = [
        GlobalMap(
            each.fused(),
            {name: part.T_global_map for name, part in each.contributions.items()},
            dict.fromkeys(each.contributions),
        )
        for each in level
    ]
    trees = [tree_lines(each, titles) for each in level]
    return FusedGroups(groups, first, details={"levels": levels, "trees": trees})


def _titles(name: str, level: Sequence[LevelMap], titles: Mapping[str, str]) -> list[str]:
    return [titles[each] for each in next(each for each in level if each.name == name).contributions]


def _map_entry(loaded: MapFiles, number: int, groups: Sequence[GlobalMap]) -> Report:
    entry: Report = {"file": str(loaded.files[number]), "group": None, "T_global_map": None, "covariance": None}
    if number not in loaded.name_of:
        return entry | {"skipped": loaded.skipped[number]}
    name = loaded.name_of[number]
    k, group = next((k, group) for k, group in enumerate(groups) if name in group.T_global_map)
    covariance = group.covariance[name]
    entry["group"] = k
    entry["T_global_map"] = loaded.pose_in_group(number, group.T_global_map[name]).tolist()
    if loaded.grids[number] is loaded.maps[name] and covariance is not None:
        entry["covariance"] = covariance.tolist()
    if loaded.first_of(name) != number:
        entry["same_as"] = loaded.title(name)
    if name in group.cells.within:
        entry["counted_within"] = loaded.title(group.cells.within[name])
    return entry


def _group_entry(loaded: MapFiles, k: int, group: GlobalMap) -> Report:
    files = [str(loaded.files[n]) for n, name in sorted(loaded.name_of.items()) if name in group.T_global_map]
    return {"group": k, "files": files, "resolution_m": group.cells.resolution_m}


def _pair_entries(loaded: MapFiles, fused: FusedGroups, registration: Registration) -> list[Report]:
    """Return what is said about pairs, each in the order of its files; files of one map are a pair too."""
    entries: list[tuple[int, int, Report]] = []
    for number, name in sorted(loaded.name_of.items()):
        a = loaded.first_of(name)
        if a != number:
            same = register(loaded.grids[a], loaded.grids[number], registration.method)
            entries.append((a, number, _verdict(same, None, 0.0) | {"same_evidence": True}))
    for (name_a, name_b), (alignment, seconds) in fused.alignments.items():
        a, b = loaded.first_of(name_a), loaded.first_of(name_b)
        entry = _verdict(alignment if a < b else alignment.inverse(), fused.withdrawn.get((name_a, name_b)), seconds)
        entries.append((min(a, b), max(a, b), entry | {"same_evidence": False}))
    entries.sort(key=lambda each: each[:2])
    return [{"a": str(loaded.files[a]), "b": str(loaded.files[b]), **entry} for a, b, entry in entries]


def _verdict(alignment: Alignment, withdrawn: str | None, seconds: float) -> Report:
    return {
        "accepted": alignment.accepted and withdrawn is None,
        **certainty_fields(alignment),
        "inliers": alignment.inliers,
        "acceptance": round(alignment.acceptance, 4),
        "reason": alignment.reason if withdrawn is None else withdrawn,
        "withdrawn": withdrawn is not None,
        "seconds": round(seconds, 3),
    }


def save_fusion(folder: Path, groups: Sequence[GlobalMap], report: Report) -> None:
    """Write the global maps and, last, the report; each file is whole at any moment."""
    with writing_to(folder):
        for k, group in enumerate(groups):
            sources = [entry["file"] for entry in report["maps"] if entry["group"] == k]
            grid = group.cells.grid()
            write_map(folder / f"global_{k}", grid, provenance={"source": " + ".join(sorted(sources))})
            write_picture(folder / f"global_{k}.png", draw_map(grid))
        partial = folder / "report.json.part"
        partial.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        partial.replace(folder / "report.json")


def remove_global_maps(folder: Path, first: int) -> None:
    """Remove the global maps of an earlier result from number `first` on."""
    with writing_to(folder):
        for file in folder.iterdir():
            number = _GLOBAL.match(file.name)
            if number is not None and FUSED.fullmatch(file.name) and int(number[1]) >= first:
                file.unlink()
