"""Maps of robots that grow: registered anew where they have changed, merged where the transform has settled.

When is fusion.readiness's decision; which pairs can be right together is fusion.consistency's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fusion.evaluation import free_points
from fusion.identity import known_area_m2
from fusion.map_graph import Structure
from fusion.map_set import MapSet
from fusion.readiness import GrowingPair, ReadinessRule, Version
from tools.fused_groups import FusedGroups, global_maps
from tools.map_files import MapFiles
from tools.pair_registration import Pair, PairRegistration
from tools.results import Report
from tools.robot_folder import RobotMap

FORMER = " before its start "


@dataclass(slots=True)
class GrowingFusion:
    """The robots' maps by their names, and what has become of each pair of robots, the lower name first."""

    registration: PairRegistration
    rule: ReadinessRule = ReadinessRule()
    robots: dict[str, RobotMap] = field(default_factory=dict)
    pairs: dict[Pair, GrowingPair] = field(default_factory=dict)
    _set: MapSet = field(default_factory=MapSet)
    _seconds: dict[Pair, float] = field(default_factory=dict)

    def replace(self, robot: str, new: RobotMap) -> None:
        """Put a robot's map in the place of its earlier one, of which nothing is left."""
        self.robots[robot] = new
        wanted = {each.hash: each.grid for each in self.robots.values()}
        for gone in set(self._set.maps) - set(wanted):
            self._set = self._set.removed(gone)
        self._set = self._set.added({name: grid for name, grid in wanted.items() if name not in self._set.maps})
        self._set = self._set.forgetful()

    def restarted(self, robot: str, former: RobotMap, new: RobotMap) -> str:
        """Keep what a robot mapped before it started again as a map of its own; return the name that it has by now.

        The new map has to earn its place anew; nothing is said of it because of the former one.
        """
        number = 1 + sum(name.startswith(robot + FORMER) for name in self.robots)
        name = f"{robot}{FORMER}{number + 1}"
        self.pairs = {_renamed(pair, robot, name): each for pair, each in self.pairs.items()}
        self.robots[name] = RobotMap(former.path, former.grid, former.hash, finished=True)
        self.replace(robot, new)
        return name

    def settle(self) -> None:
        """Register every pair of which a map has changed. What stops it half-way leaves the pairs as they were."""
        maps, pairs, seconds = self._set, dict(self.pairs), dict(self._seconds)
        robot_of = self.robot_of()
        while missing := maps.missing():
            believed = {}
            for (a, b), finished in self.registration.finish(maps.maps, missing).items():
                seconds[a, b] = finished.seconds
                first, second = sorted((robot_of[a], robot_of[b]))
                turned = first != robot_of[a]
                found = finished.alignment.inverse() if turned else finished.alignment
                pair = pairs.get((first, second), GrowingPair()).registered(
                    Version.of(found),
                    free_points(self.robots[second].grid),
                    self.rule,
                    finished=all(self.robots[each].finished for each in (first, second)),
                )
                pairs[first, second] = pair
                believed[a, b] = pair.believed.inverse() if turned else pair.believed
            maps = maps.registered(believed)
        self._set, self.pairs, self._seconds = maps, pairs, seconds

    def structure(self) -> Structure:
        """Return the groups and what was withdrawn because it contradicts others."""
        return self._set.structure(self.robot_of())

    def fused(self) -> tuple[MapFiles, FusedGroups]:
        """Return the robots' maps as files, and the global maps that follow; there must be a map."""
        names = list(self.robots)
        files = [self.robots[name].path for name in names]
        grids = {number: self.robots[name].grid for number, name in enumerate(names)}
        name_of = {number: self.robots[name].hash for number, name in enumerate(names)}
        loaded = MapFiles(files, grids, {}, dict(self._set.maps), name_of)
        structure = self.structure()
        counting = {pair: (self._set.alignments[pair], self._seconds.get(pair, 0.0)) for pair in self._set.pairs()}
        withdrawn = {each.pair: each.reason for each in structure.withdrawn}
        details: Report = {"watched": self._robots(), "growing": self._pairs()}
        return loaded, FusedGroups(global_maps(self._set, structure), counting, withdrawn, details)

    def present(self) -> dict[Pair, GrowingPair]:
        """Return the pairs of which both robots have a map: those of an earlier run may not be there yet."""
        return {pair: each for pair, each in self.pairs.items() if self.robots.keys() >= {*pair}}

    def robot_of(self) -> dict[str, str]:
        """Return the robot of each map in the set; of robots with the same map the first one."""
        robot_of: dict[str, str] = {}
        for robot, each in self.robots.items():
            robot_of.setdefault(each.hash, robot)
        return robot_of

    def _robots(self) -> list[Report]:
        return [
            {
                "robot": name,
                "file": str(each.path),
                "known_m2": round(known_area_m2(each.grid), 2),
                "finished": each.finished,
            }
            for name, each in self.robots.items()
        ]

    def _pairs(self) -> list[Report]:
        return [
            {
                "a": a,
                "b": b,
                "merged": each.merged is not None,
                "versions": len(each.versions),
                "withdrawn": each.withdrawn or None,
                "reason": each.reason,
            }
            for (a, b), each in sorted(self.present().items())
        ]


def groups_in_words(structure: Structure, robot_of: Mapping[str, str]) -> str:
    """Return which robots' maps are one, and which stand alone."""
    together = [" + ".join(robot_of[name] for name in group.maps) for group in structure.groups if len(group.maps) > 1]
    alone = [robot_of[name] for group in structure.groups if len(group.maps) == 1 for name in group.maps]
    words = [f"one map: {each}" for each in together]
    if alone:
        words.append(f"apart: {', '.join(alone)}")
    return "; ".join(words) or "no map yet"


def _renamed(pair: Pair, old: str, new: str) -> Pair:
    first, second = sorted(new if name == old else name for name in pair)
    return first, second
