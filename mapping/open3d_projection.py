"""The projection by Open3D's tensor API, where Open3D can be loaded; else the one by numpy.

Loading takes most of a second and 200 MB, so it happens only when a depth image is to be projected.
"""

from __future__ import annotations

import ctypes
import importlib.util
import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.messages import DepthImage
from mapping.depth_projection import CameraMount, Projection, project

FloatArray = NDArray[np.float64]

log = logging.getLogger(__name__)


@lru_cache(maxsize=1)
def best_projection() -> Projection:
    """Return Open3D's projection; where Open3D cannot be loaded numpy's, and say so in the log, once."""
    try:
        return open3d_projection()
    except (ImportError, OSError) as error:
        log.warning("depth is projected by numpy, because Open3D cannot be loaded (make setup-depth): %s", error)
        return project


def open3d_projection() -> Projection:
    """Return the projection by Open3D; raise ImportError or OSError where it cannot be loaded."""
    _preload_libusb()
    import open3d  # noqa: PLC0415 (slow, and not on every computer)

    open3d.utility.set_max_threads(
        1
    )  # more wait for each other longer than one needs, while the lidar is mapped beside

    tensor, float64 = open3d.core.Tensor, open3d.core.Dtype.Float64

    def project_by_open3d(image: DepthImage, mount: CameraMount) -> FloatArray:
        camera = image.camera
        intrinsics = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        cloud = open3d.t.geometry.PointCloud.create_from_depth_image(
            open3d.t.geometry.Image(tensor(np.ascontiguousarray(image.depth))),
            tensor(intrinsics, float64),
            tensor(np.linalg.inv(mount.T_base_optical), float64),
            depth_scale=1.0 / image.unit_m,
            depth_max=65536.0 * image.unit_m,
        )
        return np.asarray(cloud.point.positions.numpy(), dtype=np.float64).reshape(-1, 3)

    return project_by_open3d


def _preload_libusb() -> None:
    """Load the libusb of the package libusb-package, if it is there: Open3D needs one, and many systems have none."""
    spec = importlib.util.find_spec("libusb_package")
    if spec is None or spec.origin is None:
        return
    for library in sorted(Path(spec.origin).parent.glob("libusb-1.0.*")):
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
