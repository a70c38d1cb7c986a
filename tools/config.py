"""The configuration: frozen, validated, with defaults that work on a QCar; an unknown key is an error.

Read from YAML; `mapfuse-robot config show` prints the effective one, `config schema` its JSON schema.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, Field, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from typing_extensions import Self

from drivers.errors import yaml_fault
from mapping.depth_projection import CameraMount
from mapping.depth_sensor_model import DepthModel
from mapping.depth_views import ViewSettings
from mapping.front_end import KeyframeSettings
from mapping.graph_slam import GraphSettings
from mapping.hidden_sectors import HiddenSector
from mapping.mount import Mount
from mapping.odometry import OdometrySettings
from mapping.sensor_models import LidarModel
from mapping.slam import MappingSettings
from mapping.virtual_scan import ScanSettings
from tools.config_section import Section
from tools.drive_config import DriveSection, VehicleSection
from tools.errors import UsageError
from tools.planning_config import PlanningSection

_ODOMETRY = OdometrySettings()
_LIDAR = LidarModel()
_MAPPING = MappingSettings()
_KEYFRAMES = KeyframeSettings()
_GRAPH = GraphSettings()
_DEPTH = DepthModel()
_SCAN = ScanSettings()
_VIEWS = ViewSettings()


class ConfigError(UsageError):
    """The configuration is not usable."""


class MountSection(Section):
    """Where the laser's rotation centre sits in base_link (rear axle centre, on the ground)."""

    x_m: float = Field(0.12, description="forward of the rear axle; about the middle of a QCar: measure yours")
    y_m: float = Field(0.0, description="left of the middle")
    z_m: float = Field(0.19, description="above the ground")
    yaw_rad: float = Field(0.0, description="direction of the sensor's zero (away from its cable) on the car")
    inverted: bool = Field(False, description="the sensor hangs upside down")


class SectorSection(Section):
    """A sector in which the laser sees the car itself; as seen from the laser, counter-clockwise, 0 = ahead."""

    from_rad: float = Field(ge=-6.3, le=6.3)
    to_rad: float = Field(ge=-6.3, le=6.3)
    nearer_than_m: float | None = Field(None, gt=0, description="hide only returns below this range; null: all")


class LidarSection(Section):
    """The RPLIDAR and how it is run."""

    baud: int | None = Field(None, gt=0, le=4_000_000, description="null: 115200 and 256000 are tried")
    mode: str | None = Field(None, description="scan mode by name; null: the device's typical mode")
    motor_pwm: int = Field(660, ge=1, le=1023, description="motor duty; 660 is about 10 turns a second")
    motor: Literal["auto", "dtr", "rts", "external"] = Field(
        "auto",
        description="what switches it: auto, the accessory board if it answers, else DTR; a line; or not we",
    )
    regain_s: float = Field(10.0, ge=0, le=3600, description="how long a lost lidar is waited for; 0: not at all")
    hidden: tuple[SectorSection, ...] = Field((), description="sectors in which the car itself is seen")
    mount: MountSection = MountSection()


class CameraMountSection(Section):
    """Where the depth camera's left imager sits in base_link."""

    x_m: float = Field(0.20, description="forward of the rear axle: measure yours")
    y_m: float = Field(0.0, description="left of the middle")
    z_m: float = Field(0.20, gt=0, description="above the ground")
    roll_rad: float = 0.0
    pitch_rad: float = Field(0.0, gt=-1.6, lt=1.6, description="positive looks down; known to 1 deg the map is as good")
    yaw_rad: float = Field(0.0, description="positive looks to the left")


class DepthSection(Section):
    """The depth camera, and what becomes of its images."""

    width: int = Field(848, gt=0, le=4096, description="of the image in pixels; 848x480 is what a D435 does best")
    height: int = Field(480, gt=0, le=4096)
    fps: int = Field(30, gt=0, le=300, description="images a second")
    camera_info: str | None = Field(
        None, description="YAML with the intrinsics, for a camera that does not tell them; a RealSense does"
    )
    regain_s: float = Field(
        60.0, ge=0, description="a camera alone that is lost is looked for so long; beside a lidar until the run ends"
    )
    mount: CameraMountSection = CameraMountSection()
    odometry: Literal["scan", "cloud"] = Field(
        "scan",
        description="of a camera alone; scan: what is in its band of heights, for a car; cloud: all points, in space",
    )
    tilt: Literal["mount", "recorded", "tracked"] = Field(
        "mount",
        description="of the camera; recorded: from poses in the recording, as for one held in the hand; tracked: so for"
        " its first image (the mount's where no pose is recorded), from there on by odometry on clouds",
    )
    bottom_m: float = Field(_SCAN.bottom_m, gt=0, description="obstacles stand above this height over the floor")
    top_m: float = Field(_SCAN.top_m, gt=0, description="and below this one")
    mark_range_m: float = Field(_DEPTH.mark_range_m, gt=0, le=10, description="farther obstacles are not drawn")
    clear_range_m: float = Field(_DEPTH.clear_range_m, gt=0, le=10, description="nothing is free beyond")
    locate_range_m: float = Field(
        6.0, gt=0.5, le=6.0, description="obstacles up to here locate a car that has no lidar, noisy as they are"
    )
    hit_probability: float = Field(_DEPTH.hit_probability, gt=0.5, lt=1.0)
    miss_probability: float = Field(_DEPTH.miss_probability, gt=0.0, lt=0.5)
    view_distance_m: float = Field(_VIEWS.distance_m, gt=0, le=5, description="an image is drawn every so far")
    view_turn_rad: float = Field(_VIEWS.turn_rad, gt=0, le=3.2, description="or after turning by so much")

    @model_validator(mode="after")
    def _is_a_band(self) -> Self:
        if self.bottom_m >= self.top_m:
            raise ValueError(f"bottom_m {self.bottom_m} is not below top_m {self.top_m}")
        return self

    @model_validator(mode="after")
    def _can_be_tracked(self) -> Self:
        if self.tilt == "tracked" and self.odometry != "cloud":
            raise ValueError("tilt: tracked needs odometry: cloud, as only that knows how the camera turns in space")
        return self


class ReplaySection(Section):
    """How recordings of other programs are read."""

    scan_topic: str | None = Field(None, description="null: the LaserScan topic with the most messages")
    base_frame: str | None = Field(None, description="null: odometry's child frame, else base_link or base_footprint")
    sweep: Literal["auto", "stated", "reversed"] = Field(
        "auto",
        description="order in time of a LaserScan's samples; auto finds out, as rplidar_ros states it wrongly",
    )


class OdometrySection(Section):
    """Scan matching (kiss-icp)."""

    source: Literal["kiss", "wheel", "recorded"] = Field(
        "kiss",
        description="scan matching; wheel odometry alone, as a baseline; or the poses that a recording came with",
    )
    use_wheel_odometry: bool = Field(_MAPPING.use_wheel_odometry, description="as first guess, where there is any")
    wheel_wait_s: float = Field(_MAPPING.wheel_wait_s, ge=0, description="how long a scan waits for wheel odometry")
    map_radius_m: float = Field(_ODOMETRY.map_radius_m, gt=0, description="reach of the local map")
    voxel_m: float = Field(_ODOMETRY.voxel_m, gt=0)
    points_per_voxel: int = Field(_ODOMETRY.points_per_voxel, gt=0)
    threshold_m: float = Field(_ODOMETRY.threshold_m, gt=0, description="scale of the robust kernel")
    convergence: float = Field(_ODOMETRY.convergence, gt=0)
    max_iterations: int = Field(_ODOMETRY.max_iterations, gt=0)
    rough_convergence: float = Field(
        _ODOMETRY.rough_convergence, gt=0, description="of a match after which de-skewing is repeated"
    )
    rough_iterations: int = Field(_ODOMETRY.rough_iterations, gt=0)
    min_points: int = Field(_ODOMETRY.min_points, gt=0, description="fewer measurements are not matched")
    max_correction_m: float = Field(_ODOMETRY.max_correction_m, gt=0)
    max_correction_rad: float = Field(_ODOMETRY.max_correction_rad, gt=0)


class SlamSection(Section):
    """Keyframes, loop closure and refinement."""

    loop_closure: bool = Field(_GRAPH.loop_closure, description="look for places that were seen before")
    refine: bool = Field(True, description="match all keyframes with each other, on the way and at the end")
    keyframe_distance_m: float = Field(_KEYFRAMES.distance_m, gt=0, le=5, description="a keyframe comes every so far")
    keyframe_turn_rad: float = Field(_KEYFRAMES.turn_rad, gt=0, le=3.2, description="or after turning by so much")
    delay_keyframes: int = Field(
        _GRAPH.delay, ge=2, le=1000, description="a search begins every so many keyframes and counts as many later"
    )
    scan_every: int = Field(_MAPPING.scan_every, ge=1, le=1000, description="map only every n-th scan")


class GridSection(Section):
    """The occupancy grid and its inverse sensor model."""

    resolution_m: float = Field(_MAPPING.resolution_m, ge=0.005, le=1.0, description="metres a cell")
    hit_probability: float = Field(_LIDAR.hit_probability, gt=0.5, lt=1.0)
    miss_probability: float = Field(_LIDAR.miss_probability, gt=0.0, lt=0.5)
    max_range_m: float = Field(
        _LIDAR.max_range_m, gt=0, le=200, description="longer rays clear up to here and mark nothing"
    )
    live_s: float = Field(
        10.0, ge=0, le=3600, description="the map goes into the recording every so often; 0: at the end"
    )
    noise_fraction: float = Field(_LIDAR.noise_fraction, ge=0, lt=1, description="range noise as a share of the range")


class Config(Section):
    """All of it."""

    lidar: LidarSection = LidarSection()
    depth: DepthSection = DepthSection()
    replay: ReplaySection = ReplaySection()
    odometry: OdometrySection = OdometrySection()
    slam: SlamSection = SlamSection()
    grid: GridSection = GridSection()
    planning: PlanningSection = PlanningSection()
    vehicle: VehicleSection = VehicleSection()
    drive: DriveSection = DriveSection()

    def mapping_settings(self, *, tracked: bool = False) -> MappingSettings:
        """Return what mapping needs of this; tracked: the poses come from elsewhere and are taken as they are."""
        matches = self.odometry.source == "kiss" and not tracked
        odometry = self.odometry.model_dump(exclude={"source", "use_wheel_odometry", "wheel_wait_s"})
        return MappingSettings(
            resolution_m=self.grid.resolution_m,
            odometry=OdometrySettings(**odometry),
            keyframes=KeyframeSettings(distance_m=self.slam.keyframe_distance_m, turn_rad=self.slam.keyframe_turn_rad),
            graph=GraphSettings(
                loop_closure=self.slam.loop_closure and self.odometry.source != "recorded" and not tracked,
                delay=self.slam.delay_keyframes,
                refine_on_the_way=self.slam.refine and matches,
            ),
            lidar_model=LidarModel(**self.grid.model_dump(exclude={"resolution_m", "live_s"})),
            use_wheel_odometry=self.odometry.use_wheel_odometry or not matches,
            wheels_only=not matches,
            wheel_wait_s=self.odometry.wheel_wait_s,
            scan_every=self.slam.scan_every,
        )

    def mount(self) -> Mount:
        """Return the laser's planar pose on the body."""
        section = self.lidar.mount
        return Mount(np.array([section.x_m, section.y_m, section.yaw_rad]), section.inverted)

    def hidden_sectors(self) -> tuple[HiddenSector, ...]:
        """Return where the laser sees the car itself."""
        return tuple(
            HiddenSector(one.from_rad, one.to_rad, math.inf if one.nearer_than_m is None else one.nearer_than_m)
            for one in self.lidar.hidden
        )

    def camera_mount(self) -> CameraMount:
        """Return where the depth camera sits on the body."""
        return CameraMount(**self.depth.mount.model_dump())

    def view_settings(self) -> ViewSettings:
        """Return which depth images are drawn."""
        return ViewSettings(distance_m=self.depth.view_distance_m, turn_rad=self.depth.view_turn_rad)

    def depth_model(self) -> DepthModel:
        """Return the camera's inverse sensor model."""
        section = self.depth
        return DepthModel(
            section.hit_probability, section.miss_probability, section.mark_range_m, section.clear_range_m
        )

    def with_resolution(self, resolution_m: float | None, cells_per_meter: float | None) -> Config:
        """Return a copy with the grid resolution given in either way; raise ConfigError if both or out of range."""
        if resolution_m is None and cells_per_meter is None:
            return self
        if resolution_m is not None and cells_per_meter is not None:
            raise ConfigError("--resolution and --cells-per-meter say the same thing twice: give one")
        option = f"--resolution {resolution_m}"
        if cells_per_meter is not None:
            option = f"--cells-per-meter {cells_per_meter}"
            resolution_m = 1.0 / cells_per_meter if cells_per_meter > 0 else math.nan
        return parse({**self.model_dump(), "grid": {**self.grid.model_dump(), "resolution_m": resolution_m}}, option)

    def with_slam(self, *, loop_closure: bool | None, refine: bool | None, scan_every: int | None) -> Config:
        """Return a copy with what is given changed in the section `slam`."""
        given = {"loop_closure": loop_closure, "refine": refine, "scan_every": scan_every}
        chosen = {name: value for name, value in given.items() if value is not None}
        return self.model_copy(update={"slam": self.slam.model_copy(update=chosen)})

    def with_planning(self, chosen: Mapping[str, object]) -> Config:
        """Return a copy with what is chosen changed in the section `planning`; raise ConfigError for what cannot be."""
        given = {name: value for name, value in chosen.items() if value is not None}
        return parse({**self.model_dump(), "planning": {**self.planning.model_dump(), **given}}, "options")

    def with_odometry(self, source: Literal["kiss", "wheel", "recorded"] | None) -> Config:
        """Return a copy that takes its poses from another source; None changes nothing."""
        if source is None:
            return self
        return self.model_copy(update={"odometry": self.odometry.model_copy(update={"source": source})})


def parse(values: object, origin: str) -> Config:
    """Return the validated configuration; raise ConfigError, one line with origin, key and remedy."""
    if not isinstance(values, dict):
        raise ConfigError(f"{origin}: expected sections such as 'grid:' with keys below them")
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        path = [str(part) for part in first["loc"]]
        if first["type"] == "extra_forbidden":
            known = ", ".join(_known_keys(path[:-1]))
            problem = f"unknown key '{'.'.join(path)}'; known here: {known}"
        elif first["type"] == "model_type":
            known = ", ".join(_known_keys(path))
            problem = f"{'.'.join(path)}: expected keys below it, of {known}; got {first['input']!r}"
        else:
            problem = f"{'.'.join(path)}: {first['msg'].lower()}, got {first['input']!r}"
        raise ConfigError(f"{origin}: {problem}") from error


def load(path: Path | None) -> Config:
    """Read a YAML file; None gives the defaults. Raises ConfigError."""
    if path is None:
        return Config()
    try:
        values = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the configuration: {error.strerror}") from error
    except (YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not YAML: {yaml_fault(error)}") from error
    return parse({} if values is None else values, str(path))


def _known_keys(path: list[str]) -> list[str]:
    """Return the keys of the section at path."""
    section: type[BaseModel] = Config
    for part in path:
        annotation = section.model_fields[part].annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            section = annotation
    return list(section.model_fields)
