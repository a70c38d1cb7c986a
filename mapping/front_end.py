"""The front end: scan by scan, where the robot is relative to where it was, and which scans become keyframes.

kiss-icp matches each scan to the local map from a guess by wheel odometry or constant velocity; a scan that has moved
on becomes a keyframe and is refined point to line on its predecessors. A match that contradicts what the last keyframes
saw is weak: then a wide correlative search looks for the robot around the guess, and where that fails for long,
tracking is lost and a new segment begins, whose place in the map is unknown until a loop closure tells.

A sensor that sees little of the circle, as a depth camera does, is tied to its wheels: in each turn walls come into its
view that no local map has, and point to point they are drawn onto those that it has.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.deskew import deskew, reference_offset_s
from mapping.keyframes import KeyframeStore
from mapping.match_doubt import DoubtSettings, JudgedMatch, agreement_with, is_surprising, judge, rescue
from mapping.motion import ConstantVelocity
from mapping.mount import Mount
from mapping.odometry import LidarOdometry, OdometrySettings, ScanMatch
from mapping.scan_matching import Group, match_groups, single
from mapping.surface import share_across, surface_of
from mapping.wheel_odometry import WheelOdometry

FloatArray = NDArray[np.float64]

_SECTORS = 36  # of 10 deg
_LEAST_SECTORS = 12  # a turn with gaps is mapped if samples fall into a third of the circle
_SCANS_TO_STEP_BACK = 3
_MOST_WRONG_STAMPS = 2
_LONG_GAP_S = 0.5  # a guess without wheels after so long may be anywhere


@dataclass(frozen=True, slots=True)
class KeyframeSettings:
    """Which scans become keyframes, and how they are held to their predecessors.

    A keyframe comes every distance_m or turn_rad. It is refined on up to `predecessors` ones within reach_m, held by
    the scan match with prior_m and prior_rad (standard deviations). Without wheels the graph is told that what the
    walls leave open is known to alone_m and alone_rad. A scan with less than open_share of its walls across the others
    is held by its guess, with guess_m and guess_share of the way since the last scan, and guess_rad: that keeps a
    corridor from sliding; without wheels the robot may have changed its speed by acceleration, in m/s^2. A narrow view
    is tied to the wheels by tied_share of the way and tied_turn_share of the turn since the last scan, and at the least
    guess_m and tied_rad. After lost_s and lost_scans without a match tracking is lost.
    """

    distance_m: float = 0.25
    turn_rad: float = 0.175
    predecessors: int = 10
    reach_m: float = 5.0
    prior_m: float = 0.03
    prior_rad: float = 0.01
    alone_m: float = 0.3
    alone_rad: float = 0.05
    open_share: float = 0.05
    guess_m: float = 0.003
    guess_share: float = 0.1
    guess_rad: float = 0.05
    acceleration: float = 1.0
    tied_share: float = 0.05
    tied_turn_share: float = 0.05
    tied_rad: float = 0.003
    lost_s: float = 3.0
    lost_scans: int = 10

    def tied_deviations(self, moved: FloatArray) -> tuple[float, float]:
        """Return the standard deviations in m and rad with which wheels tell a motion (3,) of a narrow view."""
        way_m = float(np.hypot(moved[0], moved[1]))
        return self.guess_m + self.tied_share * way_m, self.tied_rad + self.tied_turn_share * abs(float(moved[2]))


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeLink:
    """A new keyframe: its number, its pose (3,) in the one before, with the information (3, 3) in its own frame.

    connected False: the first keyframe, or the first after tracking was lost; pose and information mean nothing then.
    doubtful: a match since the one before may have been wrong altogether, and no wheels vouch for it.
    """

    number: int
    T_previous_this: FloatArray
    information: FloatArray
    connected: bool
    doubtful: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class TrackedScan:
    """A scan with its pose (match.pose) in the odom frame at stamp_ns, the middle of the turn.

    points (N, 2) are de-skewed, in the body frame; keyframe is set where the scan has become one. retracted: so many
    scans before this one had stamps from the future and are taken back.
    """

    stamp_ns: int
    match: ScanMatch
    points: FloatArray
    wheel_guess: bool
    keyframe: KeyframeLink | None
    retracted: int = 0


@dataclass(slots=True)
class MappingCounters:
    """What became of the scans."""

    mapped: int = 0
    unmatched: int = 0
    skipped_partial: int = 0
    skipped_out_of_order: int = 0
    wheel_guesses: int = 0
    rescued: int = 0
    lost: int = 0


@dataclass(frozen=True, slots=True)
class FrontEndSettings:
    """Settings of the parts, and how long a scan waits for wheel odometry."""

    odometry: OdometrySettings = OdometrySettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    use_wheel_odometry: bool = True
    wheels_only: bool = False
    wheel_wait_s: float = 0.5
    doubt: DoubtSettings = DoubtSettings()


class FrontEnd:
    """Holds the local map, the keyframes' surfaces and the motion from scan to scan."""

    def __init__(self, settings: FrontEndSettings, mount: Mount) -> None:
        self.mount = mount
        self.counters = MappingCounters()
        self.keyframes = KeyframeStore(mount.pose[:2])
        self._settings = settings
        self._odometry = LidarOdometry(settings.odometry)
        self._wheels = WheelOdometry()
        self._waiting: deque[LaserScan] = deque()
        self._chain: list[FloatArray] = []  # the keyframes' refined poses, each held to those before it
        self._keyframe_odom = se2.IDENTITY  # where the scan match had put the last keyframe
        self._segment_start = 0
        self._is_doubtful = False  # whether a match since the last keyframe was
        self._all_by_wheels = True  # whether all their guesses since then were
        self._last: tuple[int, FloatArray] | None = None  # stamp and pose of the last scan
        self._earlier: deque[tuple[int, FloatArray]] = deque(maxlen=_MOST_WRONG_STAMPS)  # and of those before
        self._retracted = 0
        self._motion = ConstantVelocity()
        self._behind = 0
        self._matched_ns = 0  # stamp of the last pose that a match gave
        self._unmatched_in_a_row = 0

    def resume(self) -> None:
        """Take the keyframes that are there by now for those of an earlier drive: a new segment follows them."""
        self._chain = [se2.IDENTITY] * len(self.keyframes)
        self._segment_start = len(self._chain)

    def add_odometry(self, message: Odometry) -> list[TrackedScan]:
        """Take in wheel odometry; return the scans that had waited for it."""
        if not self._settings.use_wheel_odometry:
            return []
        self._wheels.add(message)
        return self._track_ready(message.stamp_ns)

    def add_scan(self, scan: LaserScan) -> list[TrackedScan]:
        """Take in a scan; return what could be tracked: it waits while wheel odometry for its time is on the way."""
        self._waiting.append(scan)
        return self._track_ready(_end_ns(scan))

    def finish(self) -> list[TrackedScan]:
        """Track what still waits; call once after the last message."""
        return [tracked for _ in range(len(self._waiting)) for tracked in self._track(self._waiting.popleft())]

    def _track_ready(self, now_ns: int) -> list[TrackedScan]:
        """Track the waiting scans whose odometry is there, or has not come within wheel_wait_s of message time."""
        tracked: list[TrackedScan] = []
        while self._waiting and not self._is_awaited(_end_ns(self._waiting[0]), now_ns):
            tracked += self._track(self._waiting.popleft())
        return tracked

    def _is_awaited(self, end_ns: int, now_ns: int) -> bool:
        """Whether wheel odometry up to end_ns may still come: it flows, and has not been waited for too long."""
        latest_ns, wait_ns = self._wheels.latest_ns, self._settings.wheel_wait_s * 1e9
        if latest_ns is None or latest_ns >= end_ns:
            return False
        return end_ns - latest_ns <= 2 * wait_ns and now_ns - end_ns <= wait_ns

    def _track(self, scan: LaserScan) -> list[TrackedScan]:
        """Predict, de-skew, match, doubt, learn."""
        if not scan.complete and (self._waits_for_a_whole_turn() or _seen_sectors(scan) < _LEAST_SECTORS):
            self.counters.skipped_partial += 1
            return []
        reference_s = reference_offset_s(scan.offsets_s)
        stamp_ns = scan.stamp_ns + round(reference_s * 1e9)
        if self._is_out_of_order(stamp_ns):
            self.counters.skipped_out_of_order += 1
            return []
        valid = scan.valid
        raw = self.mount.to_body(scan.angles_rad[valid], scan.ranges_m[valid])
        offsets = scan.offsets_s[valid]
        guess, twist, from_wheels = self._predict(scan, stamp_ns)
        points = deskew(raw, offsets, reference_s, twist)
        if self._settings.wheels_only:
            known = from_wheels or self._last is None
            match = ScanMatch(guess, se2.IDENTITY, accepted=known, reason="" if known else "no wheel odometry")
        elif from_wheels and _seen_sectors(scan) < _LEAST_SECTORS and len(points) >= self._settings.odometry.min_points:
            match = ScanMatch(guess, se2.IDENTITY, accepted=True)
            return [self._enter(stamp_ns, match, guess, points, from_wheels=True, is_narrow=True)]
        else:
            again = self._last is not None and bool(offsets.any())  # the match itself tells the motion within the turn
            match = self._odometry.match(points, guess, rough=again)
            if again and match.accepted:
                twist = self._motion.twist_to(stamp_ns, match.pose)
                points = deskew(raw, offsets, reference_s, twist)
                match = self._odometry.match(points, match.pose)
        return [self._enter(stamp_ns, match, guess, points, from_wheels=from_wheels)]

    def _waits_for_a_whole_turn(self) -> bool:
        """Whether to begin with the next scan: the first is the map's frame, and a lidar's first turn begins anywhere.

        A lidar that gives no whole turns is mapped all the same.
        """
        return self._last is None and self.counters.skipped_partial == 0

    def _is_out_of_order(self, stamp_ns: int) -> bool:
        """Whether a scan is older than the last one; after a few of them it was the last one's stamp that was wrong."""
        if self._last is None or stamp_ns > self._last[0]:
            self._behind = 0
            return False
        self._behind += 1
        sound = [number for number, (earlier_ns, _) in enumerate(self._earlier) if earlier_ns < stamp_ns]
        if self._behind < _SCANS_TO_STEP_BACK or not sound:
            return True  # without a sound one the clock has stepped back: wait until it has caught up
        self._retracted = len(self._earlier) - sound[-1]
        self._last = self._earlier[sound[-1]]
        while len(self._earlier) > sound[-1]:
            self._earlier.pop()
        self.counters.mapped -= self._retracted
        self.counters.skipped_out_of_order += self._retracted
        self._behind, self._matched_ns = 0, self._last[0]
        self._motion = ConstantVelocity()
        self._motion.enter(*self._last, matched=True)
        return False

    def _predict(self, scan: LaserScan, stamp_ns: int) -> tuple[FloatArray, FloatArray, bool]:
        """Return guessed pose, twist during the scan, and whether wheel odometry gave them."""
        first_ns, last_ns = scan.stamp_ns, _end_ns(scan)
        if self._last is None:
            return se2.IDENTITY, np.zeros(3), False
        previous_ns, previous = self._last
        if self._wheels.covers(min(previous_ns, first_ns), last_ns):
            guess = se2.compose(previous, self._wheels.motion(previous_ns, stamp_ns))
            sweep_s = (last_ns - first_ns) * 1e-9
            twist = se2.log(self._wheels.motion(first_ns, last_ns)) / sweep_s if sweep_s > 0 else np.zeros(3)
            return guess, twist, True
        return self._motion.predict(previous, stamp_ns), self._motion.twist, False

    def _enter(
        self,
        stamp_ns: int,
        match: ScanMatch,
        guess: FloatArray,
        points: FloatArray,
        *,
        from_wheels: bool,
        is_narrow: bool = False,
    ) -> TrackedScan:
        """Doubt the match, make a keyframe where one is due, and let the local map learn."""
        number = self.keyframes.add(surface_of(points, self.mount.pose[:2]))
        tied = self._tied(number, guess) if is_narrow and len(self._chain) > self._segment_start else None
        if tied is not None:
            match = tied
        elif not self._settings.wheels_only and len(self._chain) > self._segment_start:
            if is_narrow:
                match = self._odometry.match(points, guess)
            match = self._doubted(number, match, guess, points, stamp_ns, from_wheels=from_wheels)
            if match.accepted and not match.doubtful:
                match = self._held(number, match, guess, stamp_ns, from_wheels=from_wheels)
        self.counters.wheel_guesses += from_wheels
        self._is_doubtful |= match.doubtful or not match.accepted
        self._all_by_wheels &= from_wheels
        lost = not match.accepted and self._is_lost(stamp_ns, points)
        link = self._link(number, match.pose, is_tied=tied is not None) if match.accepted or lost else None
        if link is None:
            self.keyframes.remove_last()
        else:
            self._chain.append(se2.compose(self._chain[-1], link.T_previous_this) if link.connected else match.pose)
            self._keyframe_odom = match.pose
            self._is_doubtful, self._all_by_wheels = False, True
        if match.accepted or lost:
            self._unmatched_in_a_row = 0
            self.counters.mapped += 1
            self._matched_ns = stamp_ns
            self._odometry.learn(points, match.pose)
        else:
            self._unmatched_in_a_row += 1
            self.counters.unmatched += 1
        self._motion.enter(stamp_ns, match.pose, matched=match.accepted or lost)
        if self._last is not None:
            self._earlier.append(self._last)
        self._last = (stamp_ns, match.pose)
        retracted, self._retracted = self._retracted, 0
        return TrackedScan(stamp_ns, match, points, from_wheels, link, retracted)

    def _doubted(
        self, number: int, match: ScanMatch, guess: FloatArray, points: FloatArray, stamp_ns: int, *, from_wheels: bool
    ) -> ScanMatch:
        """Return the match if it agrees with what the last keyframes saw, else a better, a rescued or a refused one.

        After a gap the guess may be far off, and in a corridor a match at the wrong place agrees with most of the
        walls: then it has to stand against the best one of the search.
        """
        limits, clouds = self._settings.doubt, self.keyframes.snapshot()
        recent = self._recent(self._in_chain(guess))
        again, elapsed_s = self._unmatched_in_a_row > 0, self._motion.since_match_s(stamp_ns)

        def judged(candidate: ScanMatch, *, surprising: bool) -> JudgedMatch:
            return judge(
                clouds, number, candidate, self._in_chain(candidate.pose), recent, limits, surprising=surprising
            )

        first = judged(match, surprising=again or is_surprising(se2.between(guess, match.pose), limits))
        after_gap = not from_wheels and elapsed_s > _LONG_GAP_S
        is_good = first.is_sound and not (after_gap or first.surprising)
        if is_good and (from_wheels or first.agreed.hit_share >= limits.sure_share_alone):
            return match
        other = self._odometry.match(points, self._other_guess(stamp_ns, from_wheels=from_wheels))
        second = judged(other, surprising=from_wheels or again or is_surprising(other.correction, limits))
        if second.is_better_than(first):
            return replace(other, doubtful=second.surprising)
        rescued = rescue(clouds, number, self._in_chain(guess), recent, elapsed_s, limits)
        if rescued is not None:
            pose = se2.compose(self._keyframe_odom, se2.between(self._chain[-1], rescued))
            found = ScanMatch(pose, se2.between(guess, pose), accepted=True, doubtful=True)
            if judged(found, surprising=True).is_better_than(first):
                self.counters.rescued += 1
                return found
        if first.is_usable:
            return replace(match, doubtful=not is_good)
        reason = match.reason or "it contradicts what was seen before, and nothing better was found nearby"
        return ScanMatch(guess, match.correction, accepted=False, reason=reason)

    def _held(self, number: int, match: ScanMatch, guess: FloatArray, stamp_ns: int, *, from_wheels: bool) -> ScanMatch:
        """Return a match in a corridor as its walls and the guess (3,) have it; elsewhere as it is.

        Point to point, a scan clings to the places along a plain wall where points were before, so that a corridor
        becomes shorter with every scan. Point to line leaves that direction open, and the guess decides it. Source of
        the idea: Zhang, Kaess, Singh, "On degeneracy of optimization-based state estimation problems" (ICRA 2016).
        """
        limits, clouds = self._settings.keyframes, self.keyframes.snapshot()
        if self._last is None or share_across(clouds.normals_of(number)) >= limits.open_share:
            return match
        moved = se2.between(self._last[1], guess)
        deviation_m = limits.guess_m + limits.guess_share * float(np.hypot(moved[0], moved[1]))
        if not from_wheels:
            deviation_m += 0.5 * limits.acceleration * self._motion.interval_s(stamp_ns) ** 2
        pose = self._pulled(number, match.pose, guess, (deviation_m, limits.guess_rad))
        return replace(match, pose=pose, correction=se2.between(guess, pose))

    def _tied(self, number: int, guess: FloatArray) -> ScanMatch | None:
        """Return the match of a narrow view near the wheels' guess (3,); None where that contradicts what was seen.

        How much of the view was seen before does not count: in a turn it is little.
        """
        limits = self._settings.keyframes
        assert self._last is not None
        pose = self._pulled(number, guess, guess, limits.tied_deviations(se2.between(self._last[1], guess)))
        place = self._in_chain(pose)
        agreed = agreement_with(self.keyframes.snapshot(), number, place, self._recent(place))
        if agreed.hits < self._settings.doubt.weak_share * (agreed.hits + agreed.conflicts):
            return None
        return ScanMatch(pose, se2.between(guess, pose), accepted=True)

    def _pulled(self, number: int, start: FloatArray, guess: FloatArray, deviations: tuple[float, float]) -> FloatArray:
        """Return the odom pose (3,) near start (3,) to which the walls pull a scan, held by a guess (3,).

        deviations: standard deviations of the guess in m and rad.
        """
        place = self._in_chain(start)
        found = match_groups(
            self.keyframes.snapshot(), single(number), self._recent(place), place, (0.2, 0.1, 0.1),
            prior=_information(*deviations), expected=self._in_chain(guess),
        )  # fmt: skip
        return se2.compose(self._keyframe_odom, se2.between(self._chain[-1], found.pose))

    def _other_guess(self, stamp_ns: int, *, from_wheels: bool) -> FloatArray:
        """Return another kind of guess (3,): wheels that stall mislead, a velocity does once the robot brakes."""
        assert self._last is not None
        return self._motion.predict(self._last[1], stamp_ns) if from_wheels else self._last[1]

    def _is_lost(self, stamp_ns: int, points: FloatArray) -> bool:
        """Whether to give up and begin a new segment with this scan."""
        limits = self._settings.keyframes
        if self._settings.wheels_only or len(points) < self._settings.odometry.min_points:
            return False
        long = (stamp_ns - self._matched_ns) * 1e-9 > limits.lost_s
        if not (long and self._unmatched_in_a_row >= limits.lost_scans):
            return False
        self.counters.lost += 1
        self._odometry = LidarOdometry(self._settings.odometry)
        self._segment_start = len(self._chain)
        self._motion.restart()
        return True

    def _link(self, number: int, pose: FloatArray, *, is_tied: bool) -> KeyframeLink | None:
        """Return the link of a new keyframe at an odom pose (3,), tied to the wheels or not; None where none is due."""
        limits = self._settings.keyframes
        if len(self._chain) == self._segment_start:
            return KeyframeLink(number, se2.IDENTITY, np.zeros((3, 3)), connected=False)
        moved = se2.between(self._keyframe_odom, pose)
        if np.hypot(moved[0], moved[1]) < limits.distance_m and abs(moved[2]) < limits.turn_rad:
            return None
        prior = _information(*(limits.tied_deviations(moved) if is_tied else (limits.prior_m, limits.prior_rad)))
        if self._settings.wheels_only:
            return KeyframeLink(number, moved, prior, connected=True)
        near = self._recent(self._in_chain(pose))
        base = self._chain[-1]
        fixed = Group(near.keyframes, se2.between(base, near.poses))
        match = match_groups(self.keyframes.snapshot(), single(number), fixed, moved, (0.3, 0.2, 0.1), prior=prior)
        known = prior if self._all_by_wheels else _information(limits.alone_m, limits.alone_rad)
        information = match.information_with(known)
        return KeyframeLink(
            number, match.pose, information, connected=True, doubtful=self._is_doubtful and not self._all_by_wheels
        )

    def _in_chain(self, pose: FloatArray) -> FloatArray:
        """Return an odom pose (3,) as the refined chain of keyframes sees it."""
        return se2.compose(self._chain[-1], se2.between(self._keyframe_odom, pose))

    def _recent(self, pose: FloatArray) -> Group:
        """Return the last keyframes of this segment near a pose in the chain; the last is always among them."""
        first = max(self._segment_start, len(self._chain) - self._settings.keyframes.predecessors)
        numbers = np.arange(first, len(self._chain), dtype=np.int64)
        poses = np.array(self._chain[first:])
        distance = np.hypot(*(poses[:, :2] - pose[:2]).T)
        near = distance <= self._settings.keyframes.reach_m
        near[-1] = True
        return Group(numbers[near], poses[near])


def _information(deviation_m: float, deviation_rad: float) -> FloatArray:
    """Return the information (3, 3) of x, y and yaw that are known with standard deviations in m and rad."""
    return np.diag([deviation_m**-2.0, deviation_m**-2.0, deviation_rad**-2.0])


def _end_ns(scan: LaserScan) -> int:
    """Return the time of a scan's last sample."""
    return scan.stamp_ns + round(float(scan.offsets_s.max(initial=0.0)) * 1e9)


def _seen_sectors(scan: LaserScan) -> int:
    """Return the number of sectors of the circle in which a scan has samples, measurements or not."""
    sectors = np.floor(scan.angles_rad / (2.0 * np.pi) * _SECTORS).astype(np.int64) % _SECTORS
    return len(np.unique(sectors))
