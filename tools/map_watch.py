"""`fuse --watch`: folders of robots that still map are looked at again and again, and fused as far as is certain."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mapping.map_io import write_lossless
from tools.errors import ToolError
from tools.fusion_files import remove_outdated, save_fusion
from tools.fusion_report import find_robots, fusion_report
from tools.group_fusion import CACHE_NAME
from tools.growing_fusion import GrowingFusion, groups_in_words
from tools.growing_history import read_history, write_history
from tools.map_files import read_maps
from tools.map_folder import result_map
from tools.pair_cache import exact_hash
from tools.pair_registration import Pair, PairRegistration, Registration
from tools.result_folder import FUSED, check_result_folder
from tools.results import Report, new_run_folder, writing_to
from tools.robot_folder import News, NewsKind, RobotFolder, RobotMap, newest_map
from tools.signals import Stop

log = logging.getLogger(__name__)
KEPT = "kept"
_FEW = 3  # robots of which each pair is told of at each change


class _StoppedError(Exception):
    """Ends a registration that the user no longer waits for."""


@dataclass(slots=True)
class RobotFolders:
    """The robots' folders among the folders that were named, also those that appear later.

    A folder that holds maps itself is one robot's; any other may hold a folder for each robot. without: a folder that
    is none of a robot's, where the results go.
    """

    named: Sequence[Path]
    without: Path
    robots: dict[str, RobotFolder] = field(default_factory=dict)
    _parents: set[Path] = field(default_factory=set)

    def look(self) -> dict[str, News]:
        """Look at all folders once and return what is new, by the robots' names."""
        for path in self.named:
            for folder in self._folders_of(path):
                if folder.resolve() not in {each.folder.resolve() for each in self.robots.values()}:
                    self.robots[str(folder)] = RobotFolder(folder)
        found = {name: each.poll() for name, each in self.robots.items()}
        return {name: news for name, news in found.items() if news is not None}

    def _folders_of(self, path: Path) -> list[Path]:
        if str(path) in self.robots:
            return []
        if path not in self._parents and _holds_map(path):
            return [path]
        try:
            inside = sorted(each for each in path.iterdir() if each.is_dir() and not each.name.startswith("."))
        except OSError:
            return []  # not there yet, or not for the moment
        found = [each for each in inside if each.resolve() != self.without and _holds_map(each)]
        if found:
            self._parents.add(path)
        return found


def watch_maps(
    arguments: Sequence[Path],
    output: Path | None,
    registration: Registration,
    jobs: int,
    *,
    every_s: float,
    stop: Stop,
) -> tuple[Path, Report]:
    """Fuse the newest map of each robot again whenever one has changed, until `stop`; return the last result.

    arguments: folders as RobotFolders takes them, and map files, which are finished maps. Raises MapFileError for such
    a file that cannot be read, ToolError where no map came at all.
    """
    check_result_folder(output, FUSED, arguments)
    fixed = [path for path in arguments if path.is_file()]
    given = read_maps(fixed) if fixed else None
    folder = new_run_folder(output)
    folders = RobotFolders([path for path in arguments if not path.is_file()], folder.resolve())
    pairs = PairRegistration(registration, folder / CACHE_NAME, jobs, _stopper(stop))
    fusion = GrowingFusion(pairs, pairs=read_history(folder))
    changed: list[str] = []
    for number, path in enumerate(fixed):
        if given is not None and number in given.grids:
            grid = given.grids[number]
            fusion.replace(str(path), RobotMap(path, grid, exact_hash(grid), finished=True))
            changed.append(f"{path}: a finished map")
    log.info("looking every %g s for maps in %s; Ctrl-C ends it", every_s, ", ".join(map(str, folders.named)))
    report: Report | None = None
    while not stop.is_set():
        changed += _take_up(folders.look(), fusion, folder)
        if changed:
            try:
                report = _write_anew(fusion, folder, registration, changed)
            except _StoppedError:
                break
            changed = []
        stop.wait(every_s)
    if report is None:
        raise ToolError(f"no map came in {', '.join(map(str, arguments))}: name the folders that the robots write to")
    return folder, report


def _take_up(news: dict[str, News], fusion: GrowingFusion, folder: Path) -> list[str]:
    """Let new maps take their places; return what has changed, in words. Troubles are told at once."""
    changed = []
    for robot, each in news.items():
        if each.map is None:
            log.warning("%s: %s", robot, each.text)
            continue
        text = f"{robot}: {each.text}"
        if each.kind is NewsKind.restarted and each.former is not None:
            former = _kept(folder / KEPT, robot, each.former)
            text += f"; what it had mapped is kept as {fusion.restarted(robot, former, each.map)}, {former.path}"
            log.warning("%s", text)
        else:
            fusion.replace(robot, each.map)
        changed.append(text)
    return changed


def _write_anew(fusion: GrowingFusion, folder: Path, registration: Registration, changed: Sequence[str]) -> Report:
    """Register what has changed, write global maps and report, and tell of it in one line."""
    started = time.perf_counter()
    before = {pair for pair, each in fusion.pairs.items() if each.merged is not None}
    fusion.settle()
    loaded, fused = fusion.fused()
    robots = find_robots(loaded, fused)
    report = fusion_report(loaded, fused, robots, registration, fusion.registration)
    report["seconds"] = round(time.perf_counter() - started, 3)
    save_fusion(folder, loaded, fused, robots, report)
    remove_outdated(folder, fused, robots)
    write_history(folder, fusion.pairs)
    after = {pair for pair, each in fusion.pairs.items() if each.merged is not None}
    words = [*changed, *_pairs_in_words(fusion, before, after)]
    words += [f"withdrawn, it contradicts others: {reason}" for reason in fused.withdrawn.values()]
    log.info("%s; %s", "; ".join(words), groups_in_words(fusion.structure(), fusion.robot_of()))
    return report


def _pairs_in_words(fusion: GrowingFusion, before: set[Pair], after: set[Pair]) -> list[str]:
    """Return what has become of pairs: of few robots each, of many those that were merged or withdrawn."""
    few = len(fusion.robots) <= _FEW
    words = []
    for (a, b), each in sorted(fusion.present().items()):
        if few or ((a, b) in before) != ((a, b) in after):
            words.append(f"{a} with {b}: {each.reason}")
    return words


def _kept(folder: Path, robot: str, former: RobotMap) -> RobotMap:
    """Write what a robot had mapped before it started again, under a name that is free; return it with that file."""
    with writing_to(folder):
        folder.mkdir(exist_ok=True)
    stem, number = Path(robot).name or "robot", 1
    while (path := folder / f"{stem}_{number}.npz").exists():
        number += 1
    write_lossless(path, former.grid, provenance={"source": str(former.path)})
    return replace(former, path=path, finished=True)


def _holds_map(folder: Path) -> bool:
    try:
        return result_map(folder) is not None or newest_map(folder) is not None
    except (ToolError, OSError):
        return False


def _stopper(stop: Stop) -> Callable[[int, int], None]:
    """Return what is told of each finished pair, which then is in the cache: the next run begins after it."""

    def progress(_done: int, _count: int) -> None:
        if stop.is_set():
            raise _StoppedError

    return progress
