"""`mapfuse-robot evaluate features`: the thesis's comparison of feature detectors on two maps."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, print_json
from tools.errors import UsageError

log = logging.getLogger(__name__)


def features(
    a: Annotated[Path, typer.Argument(metavar="A", help="The fixed map: .yaml or .npz.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The map to match with it.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder for inliers.png and report.json.")
    ] = None,
    names: Annotated[
        str, typer.Option("--features", metavar="F,F,...", help="Detectors, or detector+descriptor.")
    ] = "kaze,kaze+kaze,sift,orb,brisk,harris,shi-tomasi",
    alphas: Annotated[
        str, typer.Option("--alphas", metavar="P,P,...", help="Thresholds of p(free); 0: the map as it is.")
    ] = "0,0.5,0.7,0.9,0.95,0.99",
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Count keypoints, matches and inliers of two maps by detector, descriptor and alpha, with the acceptance index.

    The settings are the thesis's; all of table 4.2 but SURF, which OpenCV's wheels do not have. Inliers are no proof:
    they count matches that agree on one motion, right or wrong.
    """
    from fusion.algorithm3 import THESIS
    from fusion.errors import FusionError
    from fusion.features import FeatureMethod
    from mapping.map_io import read_map
    from tools.feature_study import study_features, table_of
    from tools.plots import draw_inliers
    from tools.result_folder import FEATURES, check_result_folder, new_results
    from tools.results import writing_to

    try:
        methods = [FeatureMethod(*name.split("+", maxsplit=1)) for name in names.split(",")]
        thresholds = sorted({float(text) for text in alphas.split(",")})
        for alpha in thresholds:
            replace(THESIS, alpha=alpha)  # refuses what is no alpha
    except (FusionError, ValueError) as error:
        raise UsageError(f"--features {names} --alphas {alphas}: {error}") from error
    if output is not None:
        check_result_folder(output, FEATURES)
    trials = study_features(read_map(a), read_map(b), THESIS, (methods, thresholds), seed, log.info)
    report = {"a": str(a), "b": str(b), "seed": seed, "rows": [asdict(trial) for trial in trials]}
    if output is not None:
        folder = new_results(output, FEATURES)
        with writing_to(folder):
            draw_inliers(folder / "inliers.png", trials, f"{a.stem} and {b.stem}: matches that agree on one motion")
            (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        for line in table_of(trials):
            typer.echo(line)
