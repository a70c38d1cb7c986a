"""The camera's part of the flow: depth images to virtual scans, and those that are worth drawing to a map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from drivers.messages import DepthImage, Message, Odometry
from mapping.camera_tracking import CameraTracking
from mapping.cloud_odometry import CloudSettings
from mapping.depth_projection import CameraMount, Projection
from mapping.depth_views import DepthViews
from mapping.grid import OccupancyGrid
from mapping.mount import Mount
from mapping.open3d_projection import best_projection
from mapping.trajectory import Trajectory
from mapping.virtual_scan import ScanSettings, VirtualScan, scan_depth
from tools.config import Config


class DepthFlow:
    """Takes in depth images; `views` takes in the poses.

    mount_of: where the camera sat when it took an image. alone: there is no lidar, so that each image becomes a scan
    that the car is located by, or has a pose of its own already: `tracks`.
    """

    def __init__(
        self,
        config: Config,
        mount_of: Callable[[DepthImage], CameraMount],
        *,
        alone: bool,
        projection: Projection | None = None,
    ) -> None:
        self.views = DepthViews(config.view_settings())
        self.alone = alone
        self._resolution_m = config.grid.resolution_m
        self._model = config.depth_model()
        self._settings = ScanSettings(bottom_m=config.depth.bottom_m, top_m=config.depth.top_m)
        self._locate_range_m = config.depth.locate_range_m
        self._mount_of = mount_of
        self._projection = best_projection() if projection is None else projection
        by_clouds = config.depth.odometry == "cloud" and config.odometry.source == "kiss"
        self._tracking = (
            CameraTracking(CloudSettings(), in_hand=config.depth.tilt == "tracked") if alone and by_clouds else None
        )

    @property
    def tracks(self) -> bool:
        """Whether poses come from here, which nothing else may change."""
        return self._tracking is not None

    def add_image(self, image: DepthImage) -> list[Message]:
        """Take in an image; return the pose, and the scan to locate the car by: nothing where a lidar does that."""
        mount, poses = self._mount_of(image), list[Message]()
        if not self.alone:
            self.views.add_frame(image.stamp_ns, lambda: self._scan(image, mount))
            return []
        if self._tracking is not None:
            tracked = self._tracking.add(image, mount)
            mount = tracked.mount
            if tracked.pose is not None:
                poses = [Odometry(image.stamp_ns, tracked.pose, np.zeros(3), "odom", "base_link")]
        seen = self._scan(image, mount)
        self.views.add_frame(image.stamp_ns, lambda: seen)
        return [*poses, seen.to_laser_scan(range_max_m=self._locate_range_m)]

    def grid(self, trajectory: Trajectory) -> OccupancyGrid:
        """Return the map of what the camera saw along a trajectory."""
        return self.views.grid(trajectory, self._resolution_m, self._model)

    def summary(self) -> dict[str, int]:
        """Return what became of the images."""
        return asdict(self.views.counters)

    def _scan(self, image: DepthImage, mount: CameraMount) -> VirtualScan:
        return scan_depth(image, mount, self._settings, self._projection)


def scan_mount(camera: CameraMount) -> Mount:
    """Return where the laser would sit that gives the camera's scans."""
    return Mount(np.array([camera.x_m, camera.y_m, 0.0]))
