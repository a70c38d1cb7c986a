"""Data set of kind halmstad: tablet maps of one building of the Halmstad set, and its layout as floor plan."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapping import se2
from mapping.map_yaml import MapMode, MapYaml
from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError
from tools.map_data_set import DataSetMap, FloorPlan, MapDataSet
from tools.pair_making import copy_map
from tools.real_maps import HALMSTAD_M_PER_PX, halmstad_plan
from tools.recorded_pairs import Drive
from tools.results import writing_to

_SHIFT_M = 20.0


def halmstad_maps(drives: Sequence[Drive], plan: DataSetPlan, folder: Path) -> MapDataSet:
    """Copy the maps of a building, each with a random origin, and its layout, in whose frame the true poses are.

    drives: one, whose source is the folder maps/BUILDING. Raises ToolError where that is none.
    """
    (drive,) = drives
    source = drive.source.resolve()
    building, root = source.name, source.parent.parent
    images = sorted((source / "pseudo_occupancy").glob("*.png"))
    layout = source / f"layout/{building}_layout.png"
    if building not in HALMSTAD_M_PER_PX or not images or not layout.is_file():
        raise ToolError(f"{drive.source}: not a building of the Halmstad set: name a folder maps/BUILDING of it")
    resolution_m = HALMSTAD_M_PER_PX[building]
    plan_m, fits = halmstad_plan(root, [image.stem for image in images])
    random = np.random.default_rng([plan.seed, *building.encode()])
    maps = []
    for image, fit in zip(images, fits, strict=True):
        shift_m = random.uniform(-_SHIFT_M, _SHIFT_M, 2)
        path = copy_map(
            folder / "maps" / image.stem, image, MapYaml(image, MapMode.TRINARY, resolution_m, (0, 0, 0)), shift_m
        )
        pose = se2.compose(fit.T_a_b, [*-shift_m, 0.0])
        maps.append(DataSetMap(image.stem, path, resolution_m, robot=image.stem, pose=pose, warp_m=fit.residual_m))
    copied = folder / layout.name
    with writing_to(copied):
        shutil.copyfile(layout, copied)
    residuals = [fit.residual_m for fit in fits]
    sentence = (
        f"Real data: the {len(maps)} tablet maps of {building} in the Halmstad set, which are bent: marked points are "
        f"off the layout by {min(residuals):.2f} to {max(residuals):.2f} m (rms) at the best rigid pose, taken for "
        f"the truth; {resolution_m:g} m a pixel is nominal, and the layout's {plan_m:.4f} m a pixel follow from it."
    )
    return MapDataSet(
        folder, building, sentence, False, tuple(maps), floor_plan=FloorPlan(copied, plan_m, np.array(se2.IDENTITY))
    )
