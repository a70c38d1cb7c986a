"""ROS 2 messages in CDR <-> the messages of this project.

| ours | ROS type | topic |
|---|---|---|
| RawChunk | std_msgs/msg/UInt8MultiArray | /lidar/raw (stamp = log time) |
| LidarStream | std_msgs/msg/String holding JSON | /lidar/stream (latched) |
| LaserScan | sensor_msgs/msg/LaserScan | /scan |
| Odometry | nav_msgs/msg/Odometry | /odom |
| Imu | sensor_msgs/msg/Imu | /imu |
| Transform | tf2_msgs/msg/TFMessage | /tf, /tf_static (latched) |
| GridSnapshot | nav_msgs/msg/OccupancyGrid | /map (latched) |
| PlannedPath | nav_msgs/msg/Path | /plan (latched) |
| VelocityCommand | geometry_msgs/msg/Twist | /cmd_vel (stamp = log time) |
| DepthImage | sensor_msgs/msg/Image and what `depth_codec` puts beside it | /camera/depth/image_rect_raw |

The first two use general types (every channel of a ROS recording needs a schema), so their topic decides what they are.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.stores import ros2_humble as ros

from drivers.depth_codec import DEPTH_TOPIC
from drivers.errors import RecordingError
from drivers.messages import (
    DepthImage,
    FloatArray,
    GridSnapshot,
    Imu,
    LaserScan,
    LidarStream,
    Odometry,
    PlannedPath,
    RawChunk,
    Recordable,
    Transform,
    VelocityCommand,
)
from drivers.recording_scan import BinnedScan, bin_count, bin_scan, unbin_scan
from drivers.ros_store import from_cdr, header, header_stamp_ns, to_cdr

RAW_TYPE = "std_msgs/msg/UInt8MultiArray"
STREAM_TYPE = "std_msgs/msg/String"
SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
IMU_TYPE = "sensor_msgs/msg/Imu"
TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
GRID_TYPE = "nav_msgs/msg/OccupancyGrid"
PATH_TYPE = "nav_msgs/msg/Path"
TWIST_TYPE = "geometry_msgs/msg/Twist"
PRODUCT_TYPES = (GRID_TYPE, PATH_TYPE, TWIST_TYPE)
_NO_ORIENTATION = -1.0  # sensor_msgs/Imu: the first element of the covariance of what is not measured

SingleMessage = (
    LaserScan | Odometry | Imu | Transform | RawChunk | LidarStream | GridSnapshot | PlannedPath | VelocityCommand
)
"""What goes into one ROS message: all but a DepthImage, which takes several (see depth_codec)."""

_TYPES: dict[type[SingleMessage], str] = {
    RawChunk: RAW_TYPE,
    LidarStream: STREAM_TYPE,
    LaserScan: SCAN_TYPE,
    Odometry: ODOMETRY_TYPE,
    Imu: IMU_TYPE,
    Transform: TRANSFORM_TYPE,
    GridSnapshot: GRID_TYPE,
    PlannedPath: PATH_TYPE,
    VelocityCommand: TWIST_TYPE,
}
_TOPICS: dict[type[Recordable], str] = {
    RawChunk: "/lidar/raw",
    LidarStream: "/lidar/stream",
    LaserScan: "/scan",
    Odometry: "/odom",
    Imu: "/imu",
    Transform: "/tf",
    GridSnapshot: "/map",
    PlannedPath: "/plan",
    VelocityCommand: "/cmd_vel",
    DepthImage: DEPTH_TOPIC,
}


def ros_type(message: SingleMessage) -> str:
    """Return the ROS type that carries this message."""
    return _TYPES[type(message)]


def default_topic(message: Recordable) -> str:
    """Return the topic on which this message is recorded unless the caller says otherwise."""
    if isinstance(message, Transform) and message.static:
        return "/tf_static"
    return _TOPICS[type(message)]


def is_latched(message: SingleMessage) -> bool:
    """Tell whether a late subscriber must still get the last message (QoS durability transient_local)."""
    return isinstance(message, LidarStream | GridSnapshot | PlannedPath) or (
        isinstance(message, Transform) and message.static
    )


def encode(message: SingleMessage, scan_bins: int | None = None) -> bytes:
    """Return the message as CDR; a LaserScan goes onto `scan_bins` constant bins (default: `bin_count` of it)."""
    if isinstance(message, Transform):
        return encode_transforms([message])
    body: object
    if isinstance(message, RawChunk):
        data = np.frombuffer(message.data, dtype=np.uint8)
        body = ros.std_msgs__msg__UInt8MultiArray(ros.std_msgs__msg__MultiArrayLayout([], 0), data)
    elif isinstance(message, LidarStream):
        body = ros.std_msgs__msg__String(json.dumps(dataclasses.asdict(message)))
    elif isinstance(message, LaserScan):
        return encode_scan(message, bin_scan(message, scan_bins or bin_count(message)))
    elif isinstance(message, Odometry):
        body = _odometry_to_ros(message)
    elif isinstance(message, Imu):
        body = _imu_to_ros(message)
    elif isinstance(message, VelocityCommand):
        body = _twist(message.speed_mps, 0.0, message.yaw_rate_radps)
    elif isinstance(message, PlannedPath):
        body = _path_to_ros(message)
    else:
        body = _grid_to_ros(message)
    return to_cdr(body, ros_type(message))


def encode_scan(scan: LaserScan, rays: BinnedScan) -> bytes:
    """Return the rays that stand for a scan as a CDR sensor_msgs/msg/LaserScan."""
    return to_cdr(_scan_to_ros(scan, rays), SCAN_TYPE)


def encode_transforms(transforms: Sequence[Transform]) -> bytes:
    """Return the transforms as one CDR tf2_msgs/msg/TFMessage."""
    stamped = [
        ros.geometry_msgs__msg__TransformStamped(
            header(transform.stamp_ns, transform.parent),
            transform.child,
            ros.geometry_msgs__msg__Transform(
                ros.geometry_msgs__msg__Vector3(*transform.translation.tolist()),
                ros.geometry_msgs__msg__Quaternion(*transform.quaternion.tolist()),
            ),
        )
        for transform in transforms
    ]
    return to_cdr(ros.tf2_msgs__msg__TFMessage(stamped), TRANSFORM_TYPE)


def is_decodable(type_name: str, topic: str) -> bool:
    """Tell whether `decode` knows messages of this type on this topic."""
    suffix = {RAW_TYPE: "/lidar/raw", STREAM_TYPE: "/lidar/stream"}.get(type_name)
    return topic.endswith(suffix) if suffix else type_name in _TYPES.values()


def decode(type_name: str, data: bytes, topic: str, log_time_ns: int) -> tuple[SingleMessage, ...]:
    """Return what one CDR message holds (a TFMessage: any number of transforms).

    The type must be one that `is_decodable` accepts. Raises RecordingError when the bytes are not a message of it.
    """
    try:
        return _from_ros(from_cdr(data, type_name), topic, log_time_ns)
    except (SerdeError, ValueError, TypeError) as error:
        raise RecordingError(f"{topic}: {len(data)} bytes are not a {type_name}: {error}") from error


def _from_ros(body: object, topic: str, log_time_ns: int) -> tuple[SingleMessage, ...]:
    match body:
        case ros.std_msgs__msg__UInt8MultiArray():
            return (RawChunk(log_time_ns, body.data.tobytes()),)
        case ros.std_msgs__msg__String():
            return (_stream_from_ros(body),)
        case ros.sensor_msgs__msg__LaserScan():
            return (_scan_from_ros(body, log_time_ns),)
        case ros.nav_msgs__msg__Odometry():
            return (_odometry_from_ros(body, log_time_ns),)
        case ros.sensor_msgs__msg__Imu():
            return (_imu_from_ros(body, log_time_ns),)
        case ros.tf2_msgs__msg__TFMessage():
            return _transforms_from_ros(body, static=topic.endswith("tf_static"))
    return (_product_from_ros(body, log_time_ns),)


def _product_from_ros(body: object, log_time_ns: int) -> GridSnapshot | PlannedPath | VelocityCommand:
    match body:
        case ros.nav_msgs__msg__OccupancyGrid():
            return _grid_from_ros(body)
        case ros.nav_msgs__msg__Path():
            return _path_from_ros(body, log_time_ns)
        case ros.geometry_msgs__msg__Twist():
            return VelocityCommand(log_time_ns, body.linear.x, body.angular.z)
    raise TypeError(f"no decoder for {type(body).__name__}")


def _scan_to_ros(scan: LaserScan, binned: BinnedScan) -> ros.sensor_msgs__msg__LaserScan:
    bins = binned.ranges_m.size
    intensities = np.zeros(0) if binned.intensities is None else binned.intensities
    return ros.sensor_msgs__msg__LaserScan(
        header=header(binned.stamp_ns, scan.frame_id),
        angle_min=binned.start_rad,
        angle_max=binned.start_rad + (bins - 1) * binned.step_rad,
        angle_increment=binned.step_rad,
        time_increment=binned.step_s,
        scan_time=binned.step_s * bins,
        range_min=scan.range_min_m,
        range_max=scan.range_max_m,
        ranges=binned.ranges_m.astype(np.float32),
        intensities=intensities.astype(np.float32),
    )


def _scan_from_ros(body: ros.sensor_msgs__msg__LaserScan, log_time_ns: int) -> LaserScan:
    if not (math.isfinite(body.angle_min) and math.isfinite(body.angle_increment)):
        raise ValueError(f"angle_min {body.angle_min} and angle_increment {body.angle_increment} must be finite")
    if body.angle_increment == 0 and body.ranges.size > 1:
        raise ValueError(f"angle_increment 0 for {body.ranges.size} ranges")
    binned = BinnedScan(
        stamp_ns=header_stamp_ns(body.header) or log_time_ns,
        start_rad=body.angle_min,
        step_rad=body.angle_increment,
        step_s=body.time_increment,
        ranges_m=body.ranges.astype(np.float64),
        intensities=body.intensities.astype(np.float64) if body.intensities.size else None,
    )
    return unbin_scan(
        binned,
        range_min_m=body.range_min,
        range_max_m=body.range_max if body.range_max > 0 else math.inf,  # 0 and NaN: some drivers do not fill it in
        frame_id=body.header.frame_id,
        scan_time_s=body.scan_time,
    )


def _planar_pose(x: float, y: float, yaw: float) -> ros.geometry_msgs__msg__Pose:
    turn = ros.geometry_msgs__msg__Quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return ros.geometry_msgs__msg__Pose(ros.geometry_msgs__msg__Point(x, y, 0.0), turn)


def _xy_yaw(pose: ros.geometry_msgs__msg__Pose) -> FloatArray:
    """Project a pose on the plane: yaw of the quaternion's x axis, whatever the quaternion's length."""
    q = pose.orientation
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    return np.array([pose.position.x, pose.position.y, yaw])


def _odometry_to_ros(odometry: Odometry) -> ros.nav_msgs__msg__Odometry:
    vx, vy, wz = odometry.twist.tolist()
    return ros.nav_msgs__msg__Odometry(
        header=header(odometry.stamp_ns, odometry.frame_id),
        child_frame_id=odometry.child_frame_id,
        pose=ros.geometry_msgs__msg__PoseWithCovariance(_planar_pose(*odometry.pose.tolist()), np.zeros(36)),
        twist=ros.geometry_msgs__msg__TwistWithCovariance(_twist(vx, vy, wz), np.zeros(36)),
    )


def _odometry_from_ros(body: ros.nav_msgs__msg__Odometry, log_time_ns: int) -> Odometry:
    twist, pose = body.twist.twist, _xy_yaw(body.pose.pose)
    if not np.isfinite(pose).all():
        raise ValueError(f"pose {pose} is not finite")
    return Odometry(
        stamp_ns=header_stamp_ns(body.header) or log_time_ns,
        pose=pose,
        twist=np.array([twist.linear.x, twist.linear.y, twist.angular.z]),
        frame_id=body.header.frame_id,
        child_frame_id=body.child_frame_id,
    )


def _twist(vx: float, vy: float, wz: float) -> ros.geometry_msgs__msg__Twist:
    vector = ros.geometry_msgs__msg__Vector3
    return ros.geometry_msgs__msg__Twist(vector(vx, vy, 0.0), vector(0.0, 0.0, wz))


def _imu_to_ros(imu: Imu) -> ros.sensor_msgs__msg__Imu:
    vector, unknown = ros.geometry_msgs__msg__Vector3, np.zeros(9)
    no_orientation = np.array([_NO_ORIENTATION, *unknown[1:]])
    return ros.sensor_msgs__msg__Imu(
        header=header(imu.stamp_ns, imu.frame_id),
        orientation=ros.geometry_msgs__msg__Quaternion(0.0, 0.0, 0.0, 1.0),
        orientation_covariance=no_orientation,
        angular_velocity=vector(*imu.angular_velocity_radps.tolist()),
        angular_velocity_covariance=unknown,
        linear_acceleration=vector(*imu.acceleration_mps2.tolist()),
        linear_acceleration_covariance=unknown,
    )


def _imu_from_ros(body: ros.sensor_msgs__msg__Imu, log_time_ns: int) -> Imu:
    turning, felt = (
        np.array([vector.x, vector.y, vector.z]) for vector in (body.angular_velocity, body.linear_acceleration)
    )
    return Imu(header_stamp_ns(body.header) or log_time_ns, turning, felt, body.header.frame_id)


def _transforms_from_ros(body: ros.tf2_msgs__msg__TFMessage, *, static: bool) -> tuple[Transform, ...]:
    return tuple(_transform_from_ros(stamped, static=static) for stamped in body.transforms)


def _transform_from_ros(stamped: ros.geometry_msgs__msg__TransformStamped, *, static: bool) -> Transform:
    translation = np.array([getattr(stamped.transform.translation, axis) for axis in "xyz"])
    quaternion = np.array([getattr(stamped.transform.rotation, axis) for axis in "xyzw"])
    if not (np.isfinite(translation).all() and np.isfinite(quaternion).all() and quaternion.any()):
        raise ValueError(f"{stamped.header.frame_id} to {stamped.child_frame_id} is no transform")
    return Transform(
        stamp_ns=header_stamp_ns(stamped.header),
        parent=stamped.header.frame_id,
        child=stamped.child_frame_id,
        translation=translation,
        quaternion=quaternion,
        static=static,
    )


def _grid_to_ros(grid: GridSnapshot) -> ros.nav_msgs__msg__OccupancyGrid:
    stamped = header(grid.stamp_ns, grid.frame_id)
    rows, cols = grid.cells.shape
    origin = _planar_pose(*grid.origin.tolist())
    info = ros.nav_msgs__msg__MapMetaData(stamped.stamp, grid.resolution_m, cols, rows, origin)
    return ros.nav_msgs__msg__OccupancyGrid(stamped, info, np.ascontiguousarray(grid.cells).ravel())


def _grid_from_ros(body: ros.nav_msgs__msg__OccupancyGrid) -> GridSnapshot:
    cells = body.data.reshape(body.info.height, body.info.width)
    origin = _xy_yaw(body.info.origin)
    return GridSnapshot(header_stamp_ns(body.header), body.info.resolution, origin, cells, body.header.frame_id)


def _path_to_ros(path: PlannedPath) -> ros.nav_msgs__msg__Path:
    stamped = header(path.stamp_ns, path.frame_id)
    return ros.nav_msgs__msg__Path(
        stamped, [ros.geometry_msgs__msg__PoseStamped(stamped, _planar_pose(*pose)) for pose in path.poses.tolist()]
    )


def _path_from_ros(body: ros.nav_msgs__msg__Path, log_time_ns: int) -> PlannedPath:
    poses = np.array([_xy_yaw(stamped.pose) for stamped in body.poses]).reshape(-1, 3)
    return PlannedPath(header_stamp_ns(body.header) or log_time_ns, poses, body.header.frame_id)


def _stream_from_ros(body: ros.std_msgs__msg__String) -> LidarStream:
    """Decode the JSON of a LidarStream; keys of later versions are ignored, missing ones are errors."""
    values = json.loads(body.data)
    if not isinstance(values, dict):
        raise TypeError(f"expected a JSON object, found {body.data[:40]!r}")
    known = {field.name for field in dataclasses.fields(LidarStream)}
    return LidarStream(**{name: value for name, value in values.items() if name in known})
