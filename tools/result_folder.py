"""What a command may replace in a folder: its own earlier results, as a whole; never a recording or its input."""

from __future__ import annotations

import logging
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tools.errors import ToolError
from tools.results import check_run_folder, new_run_folder, writing_to

log = logging.getLogger(__name__)

RECORDING, REPORT = "recording.mcap", "report.json"
MAPPED = re.compile(
    r"(map|depth_map|both_map)\.(yaml|pgm|npz|png)|pose_graph\.png|trajectory(_in_map)?\.tum|slam_state\.npz"
)
FUSED = re.compile(r"global_\d+\.(yaml|pgm|npz|png)|global_\d+_[\w.-]+\.tum|tree\.png")
RATES = re.compile(r"(maps|tau)\.png")
FEATURES = re.compile(r"inliers\.png")
REGISTRATION = re.compile(r"rows\.jsonl|(success|reliability|scores)\.png")


def check_result_folder(
    chosen: Path | None, products: re.Pattern[str], inputs: Iterable[Path] = (), *, records: bool = False
) -> None:
    """Raise ToolError before the work is done where results cannot or must not go to a folder; create nothing.

    products: what the command writes beside report.json. inputs: files or folders of results that it reads. records:
    it makes a recording there.
    """
    check_run_folder(chosen)
    if chosen is None or not chosen.is_dir():
        return
    old = _products(chosen, products)
    if (old or records) and (chosen / RECORDING).exists():
        raise ToolError(f"{chosen}: holds {RECORDING}{' and what came of that drive' * bool(old)}: name another folder")
    if not old and (chosen / REPORT).exists():
        raise ToolError(f"{chosen}: holds a {REPORT} that is not of this command: name another folder")
    folder = chosen.resolve()
    for path in inputs:
        if path.resolve() == folder or (path.resolve().parent == folder and products.fullmatch(path.name)):
            raise ToolError(f"{chosen}: holds {path.name}, which is read and would be replaced: name another folder")


def new_results(chosen: Path | None, products: re.Pattern[str]) -> Path:
    """Return the folder for results, made as in `new_run_folder`, without those of an earlier run of the command."""
    folder = new_run_folder(chosen)
    with writing_to(folder):
        old = _products(folder, products)
        for file in old:
            file.unlink()
        if old:
            (folder / REPORT).unlink(missing_ok=True)
            log.info("%s: replaces the results of an earlier run there", folder)
    return folder


def check_experiment_folder(folder: Path, data: Path) -> None:
    """Raise ToolError where experiments cannot write: no place, or the folder of the maps that they read."""
    check_run_folder(folder)
    if folder.resolve() == data.resolve():
        raise ToolError(f"{folder}: holds the maps that are read: name another folder")


@contextmanager
def new_set_folder(folder: Path) -> Iterator[Path]:
    """Give a folder to fill, with `maps` in it, that takes the wanted name when all is done; ToolError if it is there.

    Nothing is left of it where the work fails.
    """
    partial_folder = folder.with_name(f"{folder.name}.part")
    with writing_to(folder):
        if folder.exists():
            raise ToolError(f"{folder}: is there already: name a new folder")
        shutil.rmtree(partial_folder, ignore_errors=True)
        (partial_folder / "maps").mkdir(parents=True)
    try:
        yield partial_folder
        with writing_to(folder):
            partial_folder.rename(folder)
    finally:
        shutil.rmtree(partial_folder, ignore_errors=True)


def _products(folder: Path, products: re.Pattern[str]) -> list[Path]:
    return [file for file in folder.iterdir() if products.fullmatch(file.name) and not file.is_dir()]
