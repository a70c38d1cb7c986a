"""Is a scan match to be believed? What the last keyframes say of it, and the search for a better one nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.correlation import SearchWindow, likelihood_field, search
from mapping.keyframes import Clouds
from mapping.odometry import ScanMatch
from mapping.scan_matching import Agreement, Group, group_agreement, match_groups, single

FloatArray = NDArray[np.float64]

_CLEARLY_MORE = 1.1  # hits of a match that takes another's place


@dataclass(frozen=True, slots=True)
class DoubtSettings:
    """When a match is believed, and where a better one is looked for.

    A match is weak with a smaller share of hits than weak_share where the last keyframes saw, or with fewer hits than
    weak_overlap of the samples. One that is farther than surprise_m or surprise_rad from the guess, or follows a weak
    one, needs the sure_share: a robot that was carried to a place that looks alike finds walls there too, but not where
    the wheels say and not as many. With less than sound_share a match gives way to a clearly better one. That is looked
    for around the guess, rescue_m and rescue_rad far and more for every second since the last match. Without wheels a
    match with less than sure_share_alone is compared with one from where the robot was.
    """

    sound_share: float = 0.85
    weak_share: float = 0.6
    weak_overlap: float = 0.15
    surprise_m: float = 0.15
    surprise_rad: float = 0.12
    sure_share: float = 0.87
    sure_share_alone: float = 0.95
    rescue_m: float = 1.0
    rescue_m_per_s: float = 1.0
    most_rescue_m: float = 3.0
    rescue_rad: float = 1.0
    rescue_rad_per_s: float = 1.5
    rescue_score: float = 0.55
    rescue_rival: float = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class JudgedMatch:
    """What the last keyframes say of a match: whether it may be used, and whether it needs no second thought.

    surprising: it lies where nobody would have expected it.
    """

    agreed: Agreement
    surprising: bool
    is_usable: bool
    is_sound: bool

    def is_better_than(self, other: JudgedMatch) -> bool:
        """Whether this one takes the other's place."""
        return self.is_usable and (not other.is_usable or self.agreed.hits > _CLEARLY_MORE * other.agreed.hits)


def judge(
    clouds: Clouds, number: int, match: ScanMatch, pose: FloatArray, recent: Group, limits: DoubtSettings,
    *, surprising: bool,
) -> JudgedMatch:  # fmt: skip
    """Return what the recent keyframes say of a match of scan `number`, at a pose (3,) in their frame."""
    agreed = agreement_with(clouds, number, pose, recent)
    is_usable = match.accepted and not is_weak(agreed, limits, surprising=surprising)
    is_sound = is_usable and agreed.hit_share >= limits.sound_share
    return JudgedMatch(agreed, surprising, is_usable, is_sound)


def agreement_with(clouds: Clouds, number: int, pose: FloatArray, recent: Group) -> Agreement:
    """Return what scan `number` at a pose (3,) and the last, third and sixth last of the keyframes say of each other.

    recent holds the keyframes, the last one at its end, in the frame of the pose.
    """
    some = Group(recent.keyframes[::-3][:3], recent.poses[::-3][:3])
    return group_agreement(clouds, single(number), some, pose, 0.15, stride=2)


def is_weak(agreement: Agreement, limits: DoubtSettings, *, surprising: bool) -> bool:
    """Whether too few of the samples lie on what was seen before; a surprising match needs more of them."""
    least_share = limits.sure_share if surprising else limits.weak_share
    return agreement.hit_share < least_share or agreement.overlap < limits.weak_overlap


def is_surprising(correction: FloatArray, limits: DoubtSettings) -> bool:
    """Whether a match is so far (3,) from the guess that it must agree all the better with what was seen before."""
    return bool(np.hypot(correction[0], correction[1]) > limits.surprise_m or abs(correction[2]) > limits.surprise_rad)


def rescue(
    clouds: Clouds, number: int, guess: FloatArray, recent: Group, elapsed_s: float, limits: DoubtSettings
) -> FloatArray | None:
    """Search around the guess (3,) for the pose (3,) at which scan `number` agrees best with the last keyframes.

    elapsed_s since the last match widens the search. None where no pose is good enough, or two are as good; what is
    found is still to be judged.
    """
    known = np.vstack(
        [
            se2.transform_points(pose, clouds.points_of(int(each)))
            for each, pose in zip(recent.keyframes, recent.poses, strict=True)
        ]
    )
    points = clouds.points_of(number)
    if len(known) == 0 or len(points) == 0:
        return None
    window = SearchWindow(
        min(limits.rescue_m + limits.rescue_m_per_s * elapsed_s, limits.most_rescue_m),
        min(limits.rescue_rad + limits.rescue_rad_per_s * elapsed_s, np.pi),
    )
    field = likelihood_field(known, 0.05, 0.1)
    thinned = points[:: max(1, len(points) // 200)]
    peak = search(field, thinned, guess, window, least_score=limits.rescue_score, rival_apart_m=0.6)
    if peak is None or peak.rival > limits.rescue_rival * peak.score:
        return None
    return match_groups(clouds, single(number), recent, peak.pose, (0.2, 0.15, 0.1)).pose
