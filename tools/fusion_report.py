"""What is told of maps that were fused: report.json of `fuse`, also of robots whose trajectories lie beside."""

from __future__ import annotations

from fusion.alignment import Alignment
from fusion.registration import register
from tools.fused_groups import FusedGroups, GlobalMap
from tools.map_alignment import certainty_fields
from tools.map_files import MapFiles
from tools.pair_registration import PairRegistration, Registration
from tools.results import Report
from tools.robot_poses import FoundRobots, find_tracks, place


def find_robots(loaded: MapFiles, fused: FusedGroups) -> FoundRobots:
    """Look for the robots' trajectories, and place those that are readable in the global maps."""
    tracks = find_tracks({number: loaded.files[number] for number in loaded.name_of})
    placed = {}
    for track in tracks:
        if track.trajectory is None:
            continue
        name = loaded.name_of[track.number]
        k, group = fused.group_of(name)
        T_group_map = group.T_global_map[name]
        poses = T_group_map, loaded.pose_in_group(track.number, T_group_map)
        placed[track.robot] = place(track, k, poses, group.covariance[name])
    return FoundRobots(tracks, placed)


def fusion_report(
    loaded: MapFiles, fused: FusedGroups, robots: FoundRobots, registration: Registration, pairs: PairRegistration
) -> Report:
    """Return what report.json holds, without the time that it took."""
    count = len(loaded.maps)
    return {
        "maps": [_map_entry(loaded, number, fused) for number in range(len(loaded.files))],
        "pairs": _pair_entries(loaded, fused, registration),
        "groups": [_group_entry(loaded, k, group) for k, group in enumerate(fused.groups)],
        "robots": robots.report(loaded.files),
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


def _map_entry(loaded: MapFiles, number: int, fused: FusedGroups) -> Report:
    entry: Report = {"file": str(loaded.files[number]), "group": None, "T_global_map": None, "covariance": None}
    if number not in loaded.name_of:
        return entry | {"skipped": loaded.skipped[number]}
    name = loaded.name_of[number]
    k, group = fused.group_of(name)
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
