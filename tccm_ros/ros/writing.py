"""Convert records to messages, for rosidl and rosbags message classes.

Messages are built by a `MessageTypes` object: rosidl classes in a live node, rosbags' typestore in
a bag.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tccm_ros.records import (
    ObjectBoxes,
    Scan,
    SurfaceCloud,
    TransformSample,
    ViewIntervals,
)
from tccm_ros.ros.pointcloud import (
    CORNER_ROW,
    HIT_ROW,
    SURFACE_ROW,
    VIEW_ROW,
    VIEWPOINT_ROW,
    cloud_message,
)
from tccm_ros.ros.types import (
    MessageTypes,
    header_message,
    quaternion_message,
    vector_message,
)


def scan_message(types: MessageTypes, scan: Scan, *, scan_time: float = 0.0) -> Any:
    """Return a sensor_msgs/LaserScan.

    Parameters
    ----------
    types
        Message classes.
    scan
        The scan.
    scan_time
        Time between two scans, s; 0 if unknown.
    """
    return types.make(
        "sensor_msgs/msg/LaserScan",
        header=header_message(types, scan.stamp_ns, scan.frame_id),
        angle_min=float(scan.angle_min),
        angle_max=float(scan.angle_min + scan.angle_increment * max(len(scan.ranges) - 1, 0)),
        angle_increment=float(scan.angle_increment),
        time_increment=float(scan.time_increment),
        scan_time=float(scan_time),
        range_min=float(scan.range_min),
        range_max=float(scan.range_max),
        ranges=types.array("f4", scan.ranges),
    )


def transform_message(types: MessageTypes, sample: TransformSample) -> Any:
    """Return a geometry_msgs/TransformStamped."""
    transform = types.make(
        "geometry_msgs/msg/Transform",
        translation=vector_message(types, sample.T_parent_child[:3, 3]),
        rotation=quaternion_message(types, sample.T_parent_child),
    )
    return types.make(
        "geometry_msgs/msg/TransformStamped",
        header=header_message(types, sample.stamp_ns, sample.parent),
        child_frame_id=sample.child,
        transform=transform,
    )


def transforms_message(types: MessageTypes, samples: Sequence[TransformSample]) -> Any:
    """Return a tf2_msgs/TFMessage."""
    transforms = [transform_message(types, sample) for sample in samples]
    return types.make("tf2_msgs/msg/TFMessage", transforms=transforms)


def surface_cloud_message(types: MessageTypes, cloud: SurfaceCloud) -> Any:
    """Return the surface message ~/surfaces, a PointCloud2 (docs/reference/nodes.md)."""
    eye = cloud.viewpoint
    rows = np.zeros(len(cloud.points), SURFACE_ROW if eye is None else VIEWPOINT_ROW)
    for k, name in enumerate("xyz"):
        rows[name] = cloud.points[:, k]
        if eye is not None:
            rows[f"vp_{name}"] = eye[k]
    rows["surface"] = cloud.surface
    if eye is not None:
        rows["sensor"] = cloud.sensor
    return cloud_message(types, cloud.stamp_ns, cloud.frame_id, rows)


def view_message(types: MessageTypes, view: ViewIntervals) -> Any:
    """Return ~/view, a sensor_msgs/PointCloud2 (docs/reference/nodes.md)."""
    passed = len(view.intervals)
    rows = np.zeros(passed + len(view.hits), HIT_ROW if len(view.hits) else VIEW_ROW)
    for k, name in enumerate(VIEW_ROW.names or ()):
        rows[name][:passed] = view.intervals[:, k]
        rows[name][passed:] = view.hits[:, k]
    if len(view.hits):
        rows["is_hit"][passed:] = 1
    return cloud_message(types, view.stamp_ns, view.frame_id, rows)


def object_boxes_message(types: MessageTypes, boxes: ObjectBoxes) -> Any:
    """Return ~/object_boxes, a sensor_msgs/PointCloud2 (docs/reference/nodes.md)."""
    corners = [len(footprint) for footprint in boxes.footprints]
    rows = np.zeros(sum(corners), CORNER_ROW)
    if corners:
        rows["x"], rows["y"] = np.concatenate(boxes.footprints).T
    rows["z"], rows["z_high"] = np.repeat(boxes.z, corners, axis=0).T
    rows["points"] = np.repeat(boxes.points, corners)
    rows["object"] = np.repeat(np.arange(len(corners)), corners)
    return cloud_message(types, boxes.stamp_ns, boxes.frame_id, rows)
