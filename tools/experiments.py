"""The thesis's experiments by the number of their figure or table, as `evaluate fusion --only` names them."""

from __future__ import annotations

from types import MappingProxyType

from tools import (
    experiment_floor_plan,
    experiment_growing,
    experiment_hierarchy,
    experiment_merges,
    experiment_runs,
)
from tools.experiment import ExperimentKind
from tools.experiment_inliers import inlier_count, inlier_precision
from tools.experiment_keypoints import keypoints_by_detector, rescaled_keypoints
from tools.experiment_rotation import rotation_by_rate, rotation_by_resolution
from tools.heterogeneous_set import lacks_rates, lacks_resolutions

EXPERIMENTS: MappingProxyType[str, ExperimentKind] = MappingProxyType(
    {
        "4.3": ExperimentKind(
            "keypoints by detector, resolution and scan rate", lacks_resolutions, keypoints_by_detector
        ),
        "4.4": ExperimentKind("KAZE keypoints of rescaled maps", lacks_resolutions, rescaled_keypoints),
        "4.5": ExperimentKind("inlier precision between resolutions", lacks_resolutions, inlier_precision),
        "4.6": ExperimentKind("inliers between resolutions", lacks_resolutions, inlier_count),
        "4.7": ExperimentKind("rotation error and time by resolution", lacks_resolutions, rotation_by_resolution),
        "4.8": ExperimentKind("rotation error and time by scan rate", lacks_rates, rotation_by_rate),
        "5.1": ExperimentKind("merging two maps many times (table 5.1)", experiment_runs.lacks, experiment_runs.run),
        "5.3": ExperimentKind("one fixed map, three resolutions", experiment_merges.lacks, experiment_merges.run),
        "5.4": ExperimentKind("when to merge two maps that grow", experiment_growing.lacks, experiment_growing.run),
        "5.5/5.6": ExperimentKind("several maps into one", experiment_hierarchy.lacks, experiment_hierarchy.run),
        "5.7": ExperimentKind("the global map on the plan", experiment_floor_plan.lacks, experiment_floor_plan.run),
    }
)
