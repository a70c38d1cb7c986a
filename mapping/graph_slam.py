"""The back end: keyframes and loops in a pose graph, and every scan's pose in the map that follows from it.

A search for loops works on what is known at one keyframe and takes effect `delay` keyframes later, wherever it runs: in
another thread while the robot drives, or at once in a replay. Both give the same map, bit for bit. The same holds for
the joint refinement: each time that the drive has doubled all keyframes are matched with each other in the background,
and what comes out replaces the measured relative poses, so that no later optimisation forgets it.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.background import Background, at_once
from mapping.front_end import KeyframeLink, TrackedScan
from mapping.graph_state import CLOUDS, SCANS, GraphState
from mapping.joint_refinement import RefinementSettings, refine_jointly
from mapping.keyframes import KeyframeStore
from mapping.loop_closure import (
    Closure,
    Drive,
    LoopOutcome,
    LoopSettings,
    close_loops,
    components_of,
    constraints_of,
    settle,
)
from mapping.pose_graph import Constraints, chi_squared
from mapping.scan_archive import PlacedScans, ScanArchive
from mapping.scan_matching import Agreement
from mapping.scan_refinement import partners_of, refine_scan
from mapping.surface import surface_of
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_LOST = np.diag([1e-6, 1e-6, 1e-4])  # information of a step over which tracking was lost: none, but not singular
_LAST_ITERATIONS = 20


@dataclass(frozen=True, slots=True)
class GraphSettings:
    """Settings of loops and refinement; a search begins every `delay` keyframes and counts as many later.

    A refinement begins with first_refinement keyframes and whenever there are twice as many as the last time, and
    counts once there are half as many again. refine_on_the_way False: only `refine` does it.
    """

    loop_closure: bool = True
    delay: int = 10
    refine_on_the_way: bool = True
    first_refinement: int = 100
    loops: LoopSettings = LoopSettings()
    refinement: RefinementSettings = RefinementSettings()
    refinement_on_the_way: RefinementSettings = RefinementSettings(gates_m=(0.3, 0.1, 0.06), full_sweeps=0)
    archive_bytes: int = 200_000_000


@dataclass(slots=True)
class GraphCounters:
    """What became of the loops, and how often all keyframes were refined on the way."""

    searches: int = 0
    refinements: int = 0
    found: int = 0
    unconfirmed: int = 0
    withdrawn: int = 0


@dataclass(frozen=True, slots=True)
class Segment:
    """A piece of the drive between two losses of tracking; in_map tells whether its place in the map is known."""

    start_ns: int
    end_ns: int
    scans: int
    in_map: bool


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraph:
    """Keyframe poses (K, 3) in the map; steps (S, 2) and closures (C, 2) as pairs of keyframe numbers."""

    poses: FloatArray
    steps: IndexArray
    closures: IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class _Refinement:
    """A refinement under way: of so many keyframes, with these closures."""

    keyframes: int
    closures: tuple[Closure, ...]
    poses: Callable[[], FloatArray | None]


class GraphSlam:
    """Holds the graph; keyframes is the front end's store, which it shares."""

    def __init__(self, settings: GraphSettings, keyframes: KeyframeStore, background: Background = at_once) -> None:
        self.counters = GraphCounters()
        self.closures: tuple[Closure, ...] = ()
        self.archive = ScanArchive(settings.archive_bytes)
        self._settings = settings
        self._keyframes = keyframes
        self._background = background
        self._pending: Callable[[], LoopOutcome] | None = None
        self._refinement: _Refinement | None = None
        self._refined = 0  # keyframes at the last refinement
        self._renewed = False  # whether measurements have changed since the last optimisation
        self._poses = np.zeros((0, 3))
        self._travelled: list[float] = []
        self._segments: list[int] = []
        self._links: list[KeyframeLink] = []

    @property
    def keyframe_poses(self) -> FloatArray:
        """The poses (K, 3) of the keyframes in the map so far."""
        return self._poses

    @property
    def is_tied(self) -> bool:
        """Whether the last keyframe hangs together with the first one, by matches and loops."""
        if not self._segments or self._segments[-1] == self._segments[0]:
            return True
        component = components_of(np.array(self._segments, dtype=np.int64), self.closures)
        return bool(component[-1] == component[0])

    def add(self, tracked: TrackedScan) -> FloatArray:
        """Take in a scan and return its pose (3,) in the map as it is known now."""
        if tracked.retracted:
            self.archive.remove_last(tracked.retracted)
        if tracked.keyframe is not None:
            self._add_keyframe(tracked.keyframe, tracked.match.pose)
        keyframe = len(self._poses) - 1
        if keyframe < 0:
            return tracked.match.pose
        T_keyframe_scan = se2.between(self._odom_pose, tracked.match.pose)
        matched = tracked.match.accepted or tracked.keyframe is not None
        self.archive.add(
            tracked.stamp_ns, keyframe, T_keyframe_scan, tracked.points,
            matched=matched, known=matched or tracked.wheel_guess, is_keyframe=tracked.keyframe is not None,
        )  # fmt: skip
        return se2.compose(self._poses[keyframe], T_keyframe_scan)

    def state(self) -> GraphState:
        """Return everything that a later drive needs to go on from here; call after `finish`."""
        clouds, closures = self._keyframes.snapshot(), self.closures
        evidence = [
            (each.score, each.rival, each.agreement.hits, each.agreement.conflicts, each.agreement.hidden)
            for each in closures
        ]
        return GraphState(
            {
                "poses": self._poses,
                "travelled": np.array(self._travelled),
                "segments": np.array(self._segments, dtype=np.int64),
                "link_poses": np.array([link.T_previous_this for link in self._links]),
                "link_information": np.array([link.information for link in self._links]),
                "link_connected": np.array([link.connected for link in self._links]),
                "link_doubtful": np.array([link.doubtful for link in self._links]),
                "closure_pairs": np.array([(each.first, each.second) for each in closures], np.int64).reshape(-1, 2),
                "closure_poses": np.array([each.T_first_second for each in closures]).reshape(-1, 3),
                "closure_information": np.array([each.information for each in closures]).reshape(-1, 3, 3),
                "closure_evidence": np.array(evidence, dtype=np.float64).reshape(-1, 5),
                "starts": clouds.starts,
                "sensor": clouds.sensor,
                **{f"cloud_{name}": getattr(clouds, name) for name in CLOUDS},
                **{f"scan_{name}": values for name, values in self.archive.arrays().items()},
            }
        )

    def restore(self, state: GraphState) -> None:
        """Go on from an earlier drive: the keyframes to come are a new segment, which a closure must tie to it."""
        arrays = state.arrays
        self._keyframes.restore(state.clouds)
        self._poses = np.array(arrays["poses"], dtype=np.float64)
        self._travelled, self._segments = arrays["travelled"].tolist(), arrays["segments"].tolist()
        links = zip(
            arrays["link_poses"], arrays["link_information"], arrays["link_connected"], arrays["link_doubtful"],
            strict=True,
        )  # fmt: skip
        self._links = [
            KeyframeLink(number, pose, information, connected=bool(connected), doubtful=bool(doubtful))
            for number, (pose, information, connected, doubtful) in enumerate(links)
        ]
        found = zip(
            arrays["closure_pairs"].tolist(), arrays["closure_poses"], arrays["closure_information"],
            arrays["closure_evidence"].tolist(), strict=True,
        )  # fmt: skip
        self.closures = tuple(
            Closure(first, second, pose, information, score, rival, Agreement(int(hits), int(conflicts), int(hidden)))
            for (first, second), pose, information, (score, rival, hits, conflicts, hidden) in found
        )
        self.archive.restore({name: arrays[f"scan_{name}"] for name in SCANS})
        self._odom_pose = se2.IDENTITY

    def finish(self) -> None:
        """Wait for the last search, look once more from the end of the drive, and optimise to the end."""
        self._take_effect()
        self._take_refinement()
        if len(self._poses) < 2 or not self._settings.loop_closure:
            return
        for query in dict.fromkeys((len(self._poses) - 1 - self._settings.loops.half_group, len(self._poses) - 1)):
            if query > 0:
                self._begin_search(query)
                self._take_effect()
        self._settle()

    def with_closures(self, added: tuple[Closure, ...]) -> GraphSlam:
        """Return a copy of this finished graph that believes more closures and has settled on them; this one stays."""
        other = copy(self)
        other.archive, other.counters = self.archive.copy(), replace(self.counters)
        other.closures = (*self.closures, *added)
        other._settle()
        return other

    def refine(self, cancelled: Callable[[], bool] = lambda: False) -> bool:
        """Refine all keyframes jointly, then all scans on them; call after `finish`. False if cancelled, no harm done.

        The poses change in one go at the end.
        """
        if len(self._poses) < 2:
            return True
        poses = self._refinement_of_keyframes(self._settings.refinement, cancelled)()
        if poses is None:
            return False
        refined: dict[int, FloatArray] = {}
        for number in range(len(self.archive)):
            if number % 256 == 0 and cancelled():
                return False
            found = self._refined_scan(number, poses)
            if found is not None:
                refined[number] = found
        self._learn(poses, self.closures)
        self._poses = poses
        for number, T_keyframe_scan in refined.items():
            self.archive.move(number, T_keyframe_scan)
        return True

    def trajectory(self) -> Trajectory:
        """Return the poses of all scans whose place in the map is known: from a match, or from the wheels."""
        stamps, keyframes, relative = self.archive.table()
        if len(stamps) == 0:
            return Trajectory(np.zeros(0, np.int64), np.zeros((0, 3)))
        in_map = self._in_map()[keyframes] & self.archive.known()
        return Trajectory(stamps[in_map], se2.compose(self._poses[keyframes[in_map]], relative[in_map]))

    def segments(self) -> list[Segment]:
        """Return the pieces of the drive: one, unless tracking was lost."""
        stamps, keyframes, _ = self.archive.table()
        of_scan, in_map = np.array(self._segments, dtype=np.int64)[keyframes], self._in_map()
        pieces = []
        for segment in range(self._segments[-1] + 1 if self._segments else 0):
            mine = np.flatnonzero(of_scan == segment)
            if len(mine):
                placed = bool(in_map[self._segments.index(segment)])
                pieces.append(Segment(int(stamps[mine[0]]), int(stamps[mine[-1]]), len(mine), placed))
        return pieces

    def pose_graph(self) -> PoseGraph:
        """Return the graph for a picture, without steps over which tracking was lost."""
        steps = [(number, number + 1) for number, link in enumerate(self._links[1:]) if link.connected]
        closures = [(closure.first, closure.second) for closure in self.closures]
        return PoseGraph(
            self._poses.copy(),
            np.array(steps, dtype=np.int64).reshape(-1, 2),
            np.array(closures, dtype=np.int64).reshape(-1, 2),
        )

    def placed(self) -> PlacedScans:
        """Return all scans where they lie now: a view, which changes with the graph."""
        return PlacedScans(self.archive, self._poses, self._in_map())

    def placed_scans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return pose (3,) in the map and points (N, 2) in the body frame of each matched scan that is kept."""
        placed = self.placed()
        return [scan for number in range(len(placed)) if (scan := placed.get(number)) is not None]

    def _add_keyframe(self, link: KeyframeLink, odom_pose: FloatArray) -> None:
        """Enter a keyframe and, every `delay` of them, let one search take effect and begin the next."""
        first = not len(self._poses)
        pose = odom_pose if first else se2.compose(self._poses[-1], self._step(link, odom_pose))
        step = np.zeros(3) if first else se2.between(self._poses[-1], pose)
        self._poses = np.vstack([self._poses, pose])
        self._travelled.append((self._travelled[-1] if self._travelled else 0.0) + float(np.hypot(step[0], step[1])))
        last = self._segments[-1] if self._segments else 0
        self._segments.append(last if link.connected or first else last + 1)
        self._links.append(link)
        self._odom_pose = odom_pose
        if self._settings.loop_closure and len(self._poses) % self._settings.delay == 0:
            self._take_effect()
            self._refine_on_the_way()
            query = len(self._poses) - 1 - self._settings.loops.half_group
            if query > 0:
                self._begin_search(query)

    def _refine_on_the_way(self) -> None:
        """Let a refinement count that was begun long enough ago, or begin one once the drive has doubled."""
        settings, count = self._settings, len(self._poses)
        if self._refinement is not None and 2 * count >= 3 * self._refinement.keyframes:
            self._take_refinement()
        if not settings.refine_on_the_way or self._refinement is not None:
            return
        if count >= max(settings.first_refinement, 2 * self._refined):
            self.counters.refinements += 1
            task = self._background(self._refinement_of_keyframes(settings.refinement_on_the_way, lambda: False))
            self._refinement = _Refinement(count, self.closures, task)

    def _refinement_of_keyframes(
        self, settings: RefinementSettings, cancelled: Callable[[], bool]
    ) -> Callable[[], FloatArray | None]:
        """Return the joint refinement of all that is known now, to be run; None comes out if it was cancelled."""
        return partial(
            refine_jointly, self._keyframes.snapshot(), self._poses.copy(),
            self._steps().joined(constraints_of(self.closures)), settings,
            kernel=self._settings.loops.kernels[-1], cancelled=cancelled,
        )  # fmt: skip

    def _take_refinement(self) -> None:
        """Wait for the pending refinement and learn from it; the next search optimises the graph with that."""
        if self._refinement is None:
            return
        refinement, self._refinement = self._refinement, None
        self._refined, poses = refinement.keyframes, refinement.poses()
        if poses is not None:
            self._learn(poses, refinement.closures)
            self._renewed = True

    def _learn(self, poses: FloatArray, closures: tuple[Closure, ...]) -> None:
        """Take the relative poses of keyframes (K, 3), refined with these closures, for the measured ones.

        A loop that they contradict stays as it is, and so does one that was found since.
        """
        self._links = [  # a new list: a copy of this graph may go on with the old one
            replace(link, T_previous_this=se2.between(poses[number - 1], poses[number]))
            if link.connected and 0 < number < len(poses)
            else link
            for number, link in enumerate(self._links)
        ]
        kept = chi_squared(poses, constraints_of(closures)) <= self._settings.loops.withdrawn_chi2
        learned = {id(closure) for closure, good in zip(closures, kept, strict=True) if good}
        self.closures = tuple(
            replace(closure, T_first_second=se2.between(poses[closure.first], poses[closure.second]))
            if id(closure) in learned
            else closure
            for closure in self.closures
        )

    def _step(self, link: KeyframeLink, odom_pose: FloatArray) -> FloatArray:
        """Return the pose (3,) of a new keyframe in the one before; after a loss, as the front end guessed it."""
        return link.T_previous_this if link.connected else se2.between(self._odom_pose, odom_pose)

    def _settle(self) -> None:
        """Optimise to the end and withdraw the closures that the others contradict."""
        if not self.closures:
            return
        self._poses = settle(self._drive(), self.closures, self._settings.loops, _LAST_ITERATIONS)
        kept = chi_squared(self._poses, constraints_of(self.closures)) <= self._settings.loops.withdrawn_chi2
        self.closures = tuple(closure for closure, good in zip(self.closures, kept, strict=True) if good)
        self.counters.withdrawn += int(np.count_nonzero(~kept))
        if not kept.all():  # also a doubted closure pulls a little
            self._poses = settle(self._drive(), self.closures, self._settings.loops, _LAST_ITERATIONS)

    def _begin_search(self, query: int) -> None:
        self.counters.searches += 1
        renewed, self._renewed = self._renewed, False
        self._pending = self._background(
            partial(close_loops, self._drive(), query, self._settings.loops, renewed=renewed)
        )

    def _drive(self) -> Drive:
        """Return what is known now, in arrays that later keyframes do not change."""
        return Drive(
            self._keyframes.snapshot(), self._poses.copy(), np.array(self._travelled),
            np.array(self._segments, dtype=np.int64), self._steps(), self.closures,
        )  # fmt: skip

    def _take_effect(self) -> None:
        """Wait for the pending search; keyframes that came after it began follow the last one that it knew."""
        if self._pending is None:
            return
        outcome, self._pending = self._pending(), None
        self.closures = outcome.closures
        self.counters.found += outcome.found
        self.counters.unconfirmed += outcome.unconfirmed
        known = len(outcome.poses)
        later = se2.between(self._poses[known - 1], self._poses[known:])
        self._poses = np.vstack([outcome.poses, se2.compose(outcome.poses[-1], later)])

    def _steps(self) -> Constraints:
        """Return the front end's relative poses as constraints, those by doubtful matches as ones that may be wrong.

        A step over a loss says nothing.
        """
        count = len(self._links) - 1
        measured = [
            link.T_previous_this if link.connected else se2.between(self._poses[number], self._poses[number + 1])
            for number, link in enumerate(self._links[1:])
        ]
        information = [link.information if link.connected else _LOST for link in self._links[1:]]
        return Constraints(
            np.arange(count), np.arange(1, count + 1), np.array(measured).reshape(-1, 3),
            np.array(information).reshape(-1, 3, 3),
            np.array([link.connected and link.doubtful for link in self._links[1:]], dtype=np.bool_),
        )  # fmt: skip

    def _in_map(self) -> NDArray[np.bool_]:
        """Return for each keyframe (K,) whether it belongs to the map: to the part with the most keyframes."""
        if not self._segments or self._segments[-1] == 0:
            return np.ones(len(self._segments), np.bool_)
        segments = np.array(self._segments, dtype=np.int64)
        component = components_of(segments, self.closures)
        return np.asarray(component == np.bincount(component).argmax())

    def _refined_scan(self, number: int, poses: FloatArray) -> FloatArray | None:
        """Return the pose (3,) in its keyframe of a scan, refined on keyframes at poses (K, 3); None where not kept."""
        scan = self.archive[number]
        if scan.is_keyframe or scan.points is None or not scan.matched or not len(scan.points):
            return None
        guess = se2.compose(poses[scan.keyframe], scan.T_keyframe_scan)
        partners = partners_of(guess, scan.keyframe, poses)
        surface = surface_of(scan.points, self._keyframes.sensor)
        refined = refine_scan(self._keyframes.snapshot(), surface, guess, partners, poses[partners])
        return se2.between(poses[scan.keyframe], refined)
