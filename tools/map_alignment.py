"""`align`: two map files in, their relative pose and how sure it is out."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from fusion.algorithm3 import Algorithm3Settings
from fusion.alignment import Alignment
from fusion.registration import Method, warm_up
from tools.alignment_picture import AlignmentView, draw_alignment
from tools.map_reading import read_saved
from tools.pair_registration import Registration, timed_register
from tools.pictures import write_picture
from tools.results import FloatArray, Report, check_run_folder, new_run_folder, writing_to


def align_maps(
    a: Path, b: Path, output: Path | None = None, *, method: Method, settings: Algorithm3Settings, seed: int
) -> Report:
    """Register two map files; (dx, dy, theta_deg) is the pose of b's map frame in a's. Raises MapFileError.

    output: a folder for alignment.png, the verdict as a picture, and alignment.json.
    """
    check_run_folder(output)
    grids = [read_saved(path) for path in (a, b)]
    registration = Registration(method, settings, seed)
    warm_up(method)
    finished = timed_register(grids[0], grids[1], registration)
    alignment = finished.alignment
    report: Report = {
        "method": method,
        "accepted": alignment.accepted,
        **certainty_fields(alignment),
        "acceptance": round(alignment.acceptance, 4),
        "inliers": alignment.inliers,
        "overlap": round(alignment.overlap, 4),
        "common_wall_m": _rounded(alignment.common_wall_m),
        "conflict_m": _rounded(alignment.conflict_m),
        "ambiguous": alignment.ambiguous,
        "scale": alignment.scale,
        "reason": alignment.reason,
        "settings": registration.settings_report(),
        "seconds": round(finished.seconds, 3),
    }
    if output is not None:
        folder = new_run_folder(output)
        with writing_to(folder):
            picture = draw_alignment(grids[0], grids[1], _view(alignment, (a.name, b.name)))
            write_picture(folder / "alignment.png", picture)
            (folder / "alignment.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return report


def _view(alignment: Alignment, names: tuple[str, str]) -> AlignmentView:
    """Return what the picture of a verdict tells."""
    verdict = "accepted" if alignment.accepted else "ambiguous" if alignment.ambiguous else "refused"
    return AlignmentView(
        verdict,
        alignment.reason,
        T_a_b=alignment.T_a_b,
        probability=alignment.probability,
        covariance=alignment.covariance,
        acceptance=alignment.acceptance,
        overlap=alignment.overlap,
        common_wall_m=alignment.common_wall_m,
        conflict_m=alignment.conflict_m,
        alternatives=tuple((each.T_a_b, each.probability) for each in alignment.alternatives),
        slide=alignment.slide,
        names=names,
    )


def certainty_fields(alignment: Alignment) -> Report:
    """Return the pose, how sure it is, and what else it could be."""
    alternatives = [{**_pose_fields(other.T_a_b), "probability": other.probability} for other in alignment.alternatives]
    return {
        "probability": alignment.probability,
        **_pose_fields(alignment.T_a_b),
        "covariance": None if alignment.covariance is None else alignment.covariance.tolist(),
        "alternatives": alternatives,
    }


def _rounded(length_m: float | None) -> float | None:
    return None if length_m is None else round(length_m, 2)


def _pose_fields(pose: FloatArray | None) -> Report:
    if pose is None:
        return {"dx": None, "dy": None, "theta_deg": None}
    x, y, yaw = np.asarray(pose).tolist()
    return {"dx": x, "dy": y, "theta_deg": math.degrees(yaw)}
