"""`fuse`: any number of map files in, one global map for each group that hangs together out."""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from fusion.alignment import Alignment
from fusion.hierarchy import LevelMap, best_pairs, first_level, next_level, tree_lines
from fusion.map_set import MapSet
from tools.fused_groups import FusedGroups, GlobalMap, global_maps
from tools.fusion_files import save_fusion
from tools.fusion_report import find_robots, fusion_report
from tools.map_files import MapFiles, read_maps
from tools.map_folder import expanded
from tools.map_looks import with_looks
from tools.pair_registration import Pair, PairRegistration, Registration
from tools.progress_line import ProgressLine
from tools.result_folder import FUSED, check_result_folder, new_results
from tools.results import Report, new_run_folder

log = logging.getLogger(__name__)
CACHE_NAME = "pairs.jsonl"


def fuse_maps(
    arguments: Sequence[Path], output: Path | None, registration: Registration, jobs: int = 1
) -> tuple[Path, Report]:
    """Fuse map files, or folders of them, into a folder, global_<k>.yaml/.pgm/.npz/.png and report.json; return both.

    A robot whose trajectory is found beside its map (see robot_poses) gets its poses in global_<k>_<robot>.tum; merging
    in levels is drawn in tree.png.

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
    robots = find_robots(loaded, fused)
    report = fusion_report(loaded, fused, robots, registration, pairs)
    report["seconds"] = round(time.perf_counter() - started, 3)
    new_results(folder, FUSED)
    save_fusion(folder, loaded, fused, robots, report)
    return folder, report


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
    return FusedGroups(groups, first, details={"levels": levels, "trees": trees}, merged=level)


def _titles(name: str, level: Sequence[LevelMap], titles: Mapping[str, str]) -> list[str]:
    return [titles[each] for each in next(each for each in level if each.name == name).contributions]
