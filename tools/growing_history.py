"""What has become of pairs of growing maps, in a file: so that `fuse --watch`, started again, does not begin anew."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path

from fusion.readiness import GrowingPair, Version
from tools.pair_cache import alignment_fields, alignment_of
from tools.pair_registration import Pair
from tools.results import Report, writing_to

log = logging.getLogger(__name__)
HISTORY_NAME = "growing.json"
_FORMAT, _VERSION = "mapfuse-growing-pairs", 1


def write_history(folder: Path, pairs: Mapping[Pair, GrowingPair]) -> None:
    """Write the pairs, by the names of their robots, whole or not at all; raises ToolError."""
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "pairs": [_entry(*each) for each in sorted(pairs.items(), key=_key)],
    }
    path = folder / HISTORY_NAME
    partial = path.with_name(f"{path.name}.part")
    with writing_to(path):
        partial.write_text(json.dumps(content) + "\n", encoding="utf-8")
        partial.replace(path)


def read_history(folder: Path) -> dict[Pair, GrowingPair]:
    """Read what an earlier run in this folder left; nothing where there is no such file, or a damaged one, as told."""
    path = folder / HISTORY_NAME
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if (content["format"], content["version"]) != (_FORMAT, _VERSION):
            raise ValueError(f"format {content['format']}, version {content['version']}")
        return dict(_pair(entry) for entry in content["pairs"])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        log.warning("%s: not what an earlier run left (%s): pairs have to settle anew", path, error)
        return {}


def _key(each: tuple[Pair, GrowingPair]) -> Pair:
    return each[0]


def _entry(robots: Pair, pair: GrowingPair) -> Report:
    return {
        "robots": list(robots),
        "versions": [
            {"alignment": alignment_fields(each.alignment), "wall_m": each.wall_m, "conflict_m": each.conflict_m}
            for each in pair.versions
        ],
        "last": None if pair.last is None else alignment_fields(pair.last),
        "merged": None if pair.merged is None else alignment_fields(pair.merged),
        "refused": pair.refused,
        "withdrawn": pair.withdrawn,
        "reason": pair.reason,
    }


def _pair(entry: Report) -> tuple[Pair, GrowingPair]:
    first, second = entry["robots"]
    return (str(first), str(second)), GrowingPair(
        versions=tuple(
            Version(alignment_of(each["alignment"]), float(each["wall_m"]), float(each["conflict_m"]))
            for each in entry["versions"]
        ),
        last=None if entry["last"] is None else alignment_of(entry["last"]),
        merged=None if entry["merged"] is None else alignment_of(entry["merged"]),
        refused=int(entry["refused"]),
        withdrawn=str(entry["withdrawn"]),
        reason=str(entry["reason"]),
    )
