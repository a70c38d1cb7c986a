"""When to merge maps that still grow (thesis section 5.4): once the transform between two of them has stopped moving.

While the robots drive, two maps are registered again and again. Of early registrations some are wrong, whatever their
inliers and their acceptance index say (figure 5.4, time index < 40); when the true one is found it stays where it is.
But a wrong one may stay as well, while the robots drive elsewhere and nothing new comes to where the maps overlap. So a
pair is merged when its last versions were all accepted and put the second map in the same place, and each of them saw
more wall agree there than the one before: what was seen since then had to fit. A merge that a later version contradicts
is withdrawn at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from mapping import se2

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReadinessRule:
    """When a transform counts as settled.

    versions: so many in a row must have been accepted. moved_m: by how much fixed points of the second map may have
    moved (rms) between any two of them, and after the merge from one version to the next. grown_m: metres of agreeing
    wall by which a version must exceed the last one to count as another: the same evidence again says nothing new.
    conflict: contradicting wall, at the most, as a share of the agreeing wall; more counts as a refusal. patience: a
    merge is withdrawn after so many versions in a row that were refused, though at the same place.
    """

    versions: int = 3
    moved_m: float = 0.3
    grown_m: float = 3.0
    conflict: float = 0.1
    patience: int = 3


@dataclass(frozen=True, slots=True, eq=False)
class Version:
    """A registration of two maps as they were at a time, and metres of wall that agree and contradict at its pose."""

    alignment: Alignment
    wall_m: float
    conflict_m: float

    @classmethod
    def of(cls, alignment: Alignment) -> Version:
        """Return a registration by the default method, which tells how much wall agrees."""
        return cls(alignment, alignment.common_wall_m or 0.0, alignment.conflict_m or 0.0)

    def is_sure(self, rule: ReadinessRule) -> bool:
        """Tell whether it speaks for a merge."""
        found = self.alignment
        return found.accepted and found.T_a_b is not None and self.conflict_m <= rule.conflict * self.wall_m


@dataclass(frozen=True, slots=True, eq=False)
class GrowingPair:
    """Two maps that grow, and what follows from their registrations so far.

    versions: the last ones in a row that speak for one place, each with more wall than the one before. last: the last
    registration, None before the first. merged: the one that is believed, None as long as the pair is apart. refused:
    how many in a row were refused since the merge. withdrawn: why the last merge was taken back, until the pair is
    merged again. reason: how things stand, in words.
    """

    versions: tuple[Version, ...] = ()
    last: Alignment | None = None
    merged: Alignment | None = None
    refused: int = 0
    withdrawn: str = ""
    reason: str = "not registered yet"

    @property
    def believed(self) -> Alignment:
        """The registration as a set of maps may use it: accepted only while the pair is merged."""
        if self.merged is not None:
            return replace(self.merged, reason=self.reason)
        return replace(self.last or Alignment(None, False, ""), accepted=False, reason=self.reason)

    def registered(
        self, version: Version, points_b: FloatArray, rule: ReadinessRule | None = None, *, finished: bool = False
    ) -> GrowingPair:
        """Return the pair after another registration of its maps.

        points_b (N, 2): fixed points of the second map, in its frame, at which motion is measured. finished: neither
        map will grow any more, so that there is nothing to wait for: the verdict alone decides, as on finished maps.
        """
        rule = rule or ReadinessRule()
        pair = replace(self, versions=_with(self.versions, version, points_b, rule), last=version.alignment)
        if pair.merged is not None:
            return _still_merged(pair, pair.merged, version, points_b, rule)
        return _apart(pair, version, points_b, rule, finished=finished)


def moved_m(one: Alignment, other: Alignment, points_b: FloatArray) -> float:
    """Return the rms distance in m between where two registrations put points (N, 2) of map b; infinite without."""
    if one.T_a_b is None or other.T_a_b is None or len(points_b) == 0:
        return float("inf")
    apart = se2.transform_points(one.T_a_b, points_b) - se2.transform_points(other.T_a_b, points_b)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _with(
    versions: tuple[Version, ...], new: Version, points_b: FloatArray, rule: ReadinessRule
) -> tuple[Version, ...]:
    """Return the versions in a row with a new one, if more wall agrees than in the last; none after a refusal."""
    if not new.is_sure(rule):
        return ()
    here = tuple(each for each in versions if moved_m(each.alignment, new.alignment, points_b) <= rule.moved_m)
    if here and new.wall_m < here[-1].wall_m + rule.grown_m:
        return here
    return (*here, new)[-rule.versions :]


def _apart(
    pair: GrowingPair, version: Version, points_b: FloatArray, rule: ReadinessRule, *, finished: bool
) -> GrowingPair:
    """Return the pair, merged if it has settled."""
    found = version.alignment
    if not found.accepted:
        return replace(pair, reason=found.reason)
    if not version.is_sure(rule):
        reason = f"too much contradicts, {version.conflict_m:.1f} m beside {version.wall_m:.0f} m of wall that agree"
        return replace(pair, reason=reason)
    if finished:
        return replace(pair, merged=found, refused=0, withdrawn="", reason=f"both maps are finished: {found.reason}")
    count = len(pair.versions)
    if count < rule.versions:
        reason = f"a place was found, {count} of {rule.versions} times in a row with more wall each time"
        return replace(pair, reason=f"{reason}: {found.reason}")
    jump_m = max(moved_m(each.alignment, found, points_b) for each in pair.versions)
    reason = f"settled: moved {jump_m:.2f} m in {count} versions: {found.reason}"
    return replace(pair, merged=found, refused=0, withdrawn="", reason=reason)


def _still_merged(
    pair: GrowingPair, merged: Alignment, version: Version, points_b: FloatArray, rule: ReadinessRule
) -> GrowingPair:
    """Return a merged pair after another version: it follows small motion, and is withdrawn after a large one."""
    found = version.alignment
    jump_m = moved_m(merged, found, points_b)
    if jump_m > rule.moved_m:
        where = "no place at all" if found.T_a_b is None else f"another place, {jump_m:.2f} m away,"
        return _withdrawn(pair, f"the merge is withdrawn: the last version says {where} and {found.reason}")
    if version.is_sure(rule):
        return replace(pair, merged=found, refused=0, reason=f"merged, moved {jump_m:.2f} m: {found.reason}")
    refused = pair.refused + 1
    if refused >= rule.patience:
        return _withdrawn(pair, f"the merge is withdrawn: refused {refused} times in a row: {found.reason}")
    return replace(pair, refused=refused, reason=f"merged; the last version alone would be refused: {found.reason}")


def _withdrawn(pair: GrowingPair, reason: str) -> GrowingPair:
    """Return the pair apart; its place is to be earned anew."""
    return replace(pair, merged=None, refused=0, withdrawn=reason, reason=reason)
