"""What speaks for each hypothesis, as numbers that a ranking can weigh: amounts of wall, ratios, rivals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.feature_places import match_maps
from fusion.hypotheses import Pool, find_hypotheses
from fusion.survey import SurveyedMap
from mapping import se2
from mapping.bending import bend_each
from mapping.map_agreement import Agreements, compare_cells, judge_placed, judge_poses

FloatArray = NDArray[np.float64]
DIFFERENT_M, DIFFERENT_RAD = 1.0, np.radians(8.0)  # poses farther apart are two places
_CONFLICT = 2.0

# What a hypothesis shows by itself and beside its rivals, and how the probability may follow each: rise with it (1),
# fall (-1), or either (0). All of it is taken twice: of the rigid pose, and with b's walls bent onto a's.
_SHOWN: dict[str, int] = {
    "log_hits_sharp": 1,
    "log_conflicts_sharp": -1,
    "hit_share_sharp": 1,
    "least_hit_share_sharp": 1,
    "clean_sharp": 1,
    "least_clean_sharp": 1,
    "net_sharp": 1,
    "log_hits_middle": 1,
    "log_conflicts_middle": -1,
    "hit_share_middle": 1,
    "least_hit_share_middle": 1,
    "clean_middle": 1,
    "least_clean_middle": 1,
    "net_middle": 1,
    "log_hits_wide": 1,
    "log_conflicts_wide": -1,
    "hit_share_wide": 1,
    "least_hit_share_wide": 1,
    "clean_wide": 1,
    "least_clean_wide": 1,
    "net_wide": 1,
    "log_parallel_sharp": 1,
    "log_parallel_middle": 1,
    "parallel_share": 1,
    "crossing_share": -1,
    "behind_share": -1,
    "log_before": 1,
    "log_weak": 1,
    "log_least_weak": 1,
    "log_turning": 1,
    "log_good_blocks": 1,
    "log_bad_blocks": -1,
    "good_block_share": 1,
    "log_worst_middle": -1,
    "log_against_middle": -1,
    "log_worst_wide": -1,
    "log_against_wide": -1,
    "log_good_lines": 1,
    "log_bad_lines": -1,
    "good_line_share": 1,
    "least_variety": 1,
    "log_rough": 1,
    "hit_gap": -1,
    "sharpness": 0,
    "against_share_middle": -1,
    "against_share_wide": -1,
    "net_of_best_sharp": 1,
    "rival_sharp": -1,
    "lead_sharp": 1,
    "rivals_sharp": -1,
    "net_of_best_middle": 1,
    "rival_middle": -1,
    "lead_middle": 1,
    "rivals_middle": -1,
    "net_of_best_wide": 1,
    "rival_wide": -1,
    "lead_wide": 1,
    "rivals_wide": -1,
}
_BENT = "bent_"  # before the names of the second kind
TRENDS: dict[str, int] = {
    **_SHOWN,
    **{_BENT + name: trend for name, trend in _SHOWN.items()},
    "log_strain": -1,
    "log_known": 0,
    "known_share": 0,
    "log_smaller_wall": 0,
    "omega": 1,
    "log_odds_omega": -1,
    "log_common_free": 0,
    "common_free_share": 0,
    "log_disagreeing": -1,
    "log_matches": 1,
    "matches_of_best": 1,
}


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The evidence for K hypotheses.

    features: name -> (K,); b_on_a, a_on_b: metres of each map's wall on the other; free_m2, agreeing_m2,
    disagreeing_m2 (K,): areas; omega (K,): the acceptance index (3.15).
    """

    features: dict[str, FloatArray]
    b_on_a: Agreements
    a_on_b: Agreements
    free_m2: FloatArray
    omega: FloatArray
    overlap_share: FloatArray

    def overlap(self, number: int) -> float:
        """Return the cells known in both maps, as a share of the smaller map's known cells, at a hypothesis."""
        return float(self.overlap_share[number])


def judged_places(a: SurveyedMap, b: SurveyedMap, seed: int) -> tuple[Pool, Evidence]:
    """Look for places of map b on map a, and for what speaks for each; both must have walls and free space."""
    pool = find_hypotheses(a, b, match_maps(a, b), seed=seed)
    return pool, gather(a, b, pool)


def gather(a: SurveyedMap, b: SurveyedMap, pool: Pool) -> Evidence:
    """Judge every pose of a pool both ways."""
    least_cell_m = max(a.walls.resolution_m, b.walls.resolution_m)
    forth = judge_poses(a.surface, b.probe, pool.poses, least_cell_m)
    back = judge_poses(b.surface, a.probe, se2.inverse(pool.poses), least_cell_m)
    free, both_wall, one_each = compare_cells(a.surface, b.cells, b.states, b.cell_area_m2, pool.poses)
    omega = (free + both_wall) / np.maximum(free + both_wall + one_each, 1e-9)
    different = different_places(pool.poses, b)
    features = _shown(forth, back, different) | _areas(a, b, free, one_each, omega) | _search(pool)
    features |= _sizes(a, b, 0.5 * (forth.known + back.known))
    bent, strain_m = _bent(a, b, pool.poses, least_cell_m)
    features |= {_BENT + name: values for name, values in _shown(*bent, different).items()}
    features["log_strain"] = np.log(0.02 + strain_m)
    overlap = (free + both_wall + one_each) / max(min(a.known_m2, b.known_m2), 1e-9)
    return Evidence(features, forth, back, free, omega, np.minimum(overlap, 1.0))


def _bent(
    a: SurveyedMap, b: SurveyedMap, poses: FloatArray, least_cell_m: float
) -> tuple[tuple[Agreements, Agreements], FloatArray]:
    """Return how poses (K, 3) agree both ways with the moving map bent onto the other, and by how much in m (K,)."""
    back = se2.inverse(poses)
    onto_a = bend_each(a.walls, b.rough.points, b.rough.lengths, poses)
    onto_b = bend_each(b.walls, a.rough.points, a.rough.lengths, back)
    agreements = (
        judge_placed(a.surface, b.rough, onto_a.placed, poses, least_cell_m),
        judge_placed(b.surface, a.rough, onto_b.placed, back, least_cell_m),
    )
    return agreements, 0.5 * (onto_a.strain_m + onto_b.strain_m)


def _shown(forth: Agreements, back: Agreements, different: NDArray[np.bool_]) -> dict[str, FloatArray]:
    """Return what each hypothesis shows by itself and beside its rivals, of which different (K, K) are elsewhere."""
    return _own(forth, back) | _rivals(forth, back, different)


def _own(forth: Agreements, back: Agreements) -> dict[str, FloatArray]:
    """Return what each hypothesis shows by itself."""
    features: dict[str, FloatArray] = {}
    known = 0.5 * (forth.known + back.known)
    for level, name in enumerate(("sharp", "middle", "wide")):
        hits = 0.5 * (forth.hits[:, level] + back.hits[:, level])
        conflicts = 0.5 * (forth.conflicts[:, level] + back.conflicts[:, level])
        shares = [each.hits[:, level] / np.maximum(each.known, 0.1) for each in (forth, back)]
        clean = [_share(each.hits[:, level], each.conflicts[:, level]) for each in (forth, back)]
        features[f"log_hits_{name}"] = np.log1p(hits)
        features[f"log_conflicts_{name}"] = np.log1p(conflicts)
        features[f"hit_share_{name}"] = hits / np.maximum(known, 0.1)
        features[f"least_hit_share_{name}"] = np.minimum(*shares)
        features[f"clean_{name}"] = _share(hits, conflicts)
        features[f"least_clean_{name}"] = np.minimum(*clean)
        features[f"net_{name}"] = _signed_log(hits - _CONFLICT * conflicts)
    features["log_parallel_sharp"] = np.log1p(0.5 * (forth.parallel[:, 0] + back.parallel[:, 0]))
    features["log_parallel_middle"] = np.log1p(0.5 * (forth.parallel[:, 1] + back.parallel[:, 1]))
    parallel = forth.parallel[:, 1] + back.parallel[:, 1]
    features["parallel_share"] = parallel / np.maximum(forth.hits[:, 1] + back.hits[:, 1], 0.1)
    features["crossing_share"] = (forth.crossing + back.crossing) / np.maximum(
        forth.crossing + back.crossing + parallel, 0.1
    )
    facing = forth.before + back.before + forth.behind + back.behind
    features["behind_share"] = (forth.behind + back.behind) / np.maximum(facing, 0.5)
    features["log_before"] = np.log1p(0.5 * (forth.before + back.before))
    features["log_weak"] = np.log1p(0.5 * (forth.weak + back.weak))
    features["log_least_weak"] = np.log1p(np.minimum(forth.weak, back.weak))
    features["log_turning"] = np.log1p(0.5 * (forth.turning + back.turning))
    features["log_good_blocks"] = np.log1p(forth.good + back.good)
    features["log_bad_blocks"] = np.log1p(forth.bad + back.bad)
    features["good_block_share"] = _share(forth.good + back.good, forth.bad + back.bad)
    for level, name in enumerate(("middle", "wide")):
        features[f"log_worst_{name}"] = np.log1p(np.maximum(forth.worst[:, level], back.worst[:, level]))
        features[f"log_against_{name}"] = np.log1p(forth.against[:, level] + back.against[:, level])
    features["sharpness"] = (forth.parallel[:, 0] + back.parallel[:, 0]) / np.maximum(parallel, 0.2)
    for level, name in enumerate(("middle", "wide")):
        features[f"against_share_{name}"] = _share(forth.against[:, level] + back.against[:, level], parallel)
    features["log_good_lines"] = np.log1p(forth.good_lines + back.good_lines)
    features["log_bad_lines"] = np.log1p(forth.bad_lines + back.bad_lines)
    features["good_line_share"] = _share(forth.good_lines + back.good_lines, forth.bad_lines + back.bad_lines)
    features["least_variety"] = np.log(np.minimum(forth.variety, back.variety))
    features["log_rough"] = np.log1p(0.5 * (forth.rough + back.rough))
    features["hit_gap"] = 0.5 * (forth.hit_gap + back.hit_gap)
    return features


def _sizes(a: SurveyedMap, b: SurveyedMap, known: FloatArray) -> dict[str, FloatArray]:
    """Return how much there is to agree on; known (K,): metres of wall where the other map knows something."""
    smaller_m = min(a.wall_m, b.wall_m)
    return {
        "log_known": np.log1p(known),
        "known_share": known / max(smaller_m, 1.0),
        "log_smaller_wall": np.full(len(known), np.log1p(smaller_m)),
    }


def _areas(
    a: SurveyedMap, b: SurveyedMap, free: FloatArray, one_each: FloatArray, omega: FloatArray
) -> dict[str, FloatArray]:
    return {
        "omega": omega,
        "log_odds_omega": np.log((1.0 - omega) + 0.002),
        "log_common_free": np.log1p(free),
        "common_free_share": free / max(min(a.free_m2, b.free_m2), 1.0),
        "log_disagreeing": np.log1p(one_each),
    }


def _search(pool: Pool) -> dict[str, FloatArray]:
    return {
        "log_matches": np.log1p(pool.matches),
        "matches_of_best": pool.matches / max(float(pool.matches.max()), 1.0),
    }


def _rivals(forth: Agreements, back: Agreements, different: NDArray[np.bool_]) -> dict[str, FloatArray]:
    """Return how each hypothesis stands against the others, and against those at another place."""
    features: dict[str, FloatArray] = {}
    for level, name in enumerate(("sharp", "middle", "wide")):
        net = np.maximum(
            0.0,
            0.5 * (forth.hits + back.hits)[:, level] - 0.5 * _CONFLICT * (forth.conflicts + back.conflicts)[:, level],
        )
        best = max(net.max(), 0.1)
        rival = np.where(different, net[np.newaxis, :], 0.0).max(axis=1)
        features[f"net_of_best_{name}"] = net / best
        features[f"rival_{name}"] = np.minimum(rival / np.maximum(net, 0.1), 5.0)
        features[f"lead_{name}"] = _signed_log(net - rival)
        features[f"rivals_{name}"] = np.log1p((different & (net[np.newaxis, :] > 0.8 * net[:, np.newaxis])).sum(axis=1))
    return features


def different_places(poses: FloatArray, b: SurveyedMap) -> NDArray[np.bool_]:
    """Return (K, K) which of poses (K, 3) put the middle of map b's walls at different places or turn it otherwise."""
    centres = se2.compose(poses, np.array([*b.probe.points.mean(axis=0), 0.0]))
    apart = np.hypot(*(centres[:, np.newaxis, :2] - centres[np.newaxis, :, :2]).transpose(2, 0, 1))
    turned = np.abs(se2.wrap_angle(centres[:, np.newaxis, 2] - centres[np.newaxis, :, 2]))
    return np.asarray((apart > DIFFERENT_M) | (turned > DIFFERENT_RAD))


def _share(part: FloatArray, rest: FloatArray) -> FloatArray:
    return np.asarray(part / np.maximum(part + rest, 0.1))


def _signed_log(value: FloatArray) -> FloatArray:
    return np.asarray(np.sign(value) * np.log1p(np.abs(value)))
