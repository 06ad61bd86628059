"""Depth images: their streams, and conversion to points.

An image waits for its calibration (`join_camera`), has one pose, at its stamp, and is thinned to
half of a cell. The noise is a function of depth (`sensors.depth_sigma`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.config import Config
from tccm_ros.records import CameraImage, CameraInfo, DepthImage, Posed, SensorKind
from tccm_ros.robot import MountKind, Stream
from tccm_ros.robot.streams import Companion
from tccm_ros.sensors.camera_rays import has_known_lens, pixel_rays
from tccm_ros.sensors.compressed_depth import PLUGIN
from tccm_ros.sensors.depth_kernels import DepthLimits, SightLines, place_image
from tccm_ros.sensors.depth_messages import CAMERA_INFO_READER, COMPRESSED_READER, IMAGE_READER
from tccm_ros.sensors.measured import MeasuredPoints, in_region, without_robot

COMPRESSED = (PLUGIN, "compressed")
"""Topic suffixes of compressed depth images (image_transport), the preferred one first."""

RECTIFIED = "image_rect"
"""Topic suffix of images rectified by image_proc: P of the calibration applies."""

EDGE_SIGMAS = 4.0
"""Neighbouring depths that differ by less than this many sigmas are on one surface."""

MIN_SIGHT_ANGLE = 0.14
"""Minimum angle between ray and surface, rad; a steeper step between neighbouring pixels is an
edge. It corresponds to `scan.shadow_angle` of lasers."""

PASSED_SIGMAS = 3.0
"""Distance, in sigmas, by which free space ends before a surface that is too noisy to map."""

LINES_PER_COLUMN = 2.0
"""Traced rays per column of `views.cell_size` at the distance `views.reach`."""


Picture = TypeVar("Picture", DepthImage, CameraImage)

MAX_WAITING = 100
"""Maximum number of waiting images: 61 MB of 640 x 480 pixels."""


class PosedImage(Posed):
    """A depth image with the pose of its camera."""

    __slots__ = ()
    sensor_kind = SensorKind.DEPTH_IMAGE

    @property
    def image(self) -> DepthImage:
        """The image."""
        image: DepthImage = self.record
        return image


def uncompressed(topic: str) -> str:
    """Return the topic of the raw image of a compressed topic; other topics are unchanged."""
    before, _, last = topic.rpartition("/")
    return before if last in COMPRESSED else topic


def camera_info_topic(topic: str) -> str:
    """Return the topic of the calibration of an image, which is next to the raw image."""
    before, slash, _ = uncompressed(topic).rpartition("/")
    return f"{before}{slash}camera_info"


def is_compressed(topic: str) -> bool:
    """Return whether a topic has compressed depth images."""
    return uncompressed(topic) != topic


def is_rectified(topic: str) -> bool:
    """Return whether a topic has rectified images."""
    return uncompressed(topic).rsplit("/", 1)[-1] == RECTIFIED


TOO_FAR = "depths beyond scan.max_range: 32FC1 is m, are they millimetres?"
TOO_FAR_MM = "depths beyond scan.max_range: 16UC1 is mm, are they in another unit, or no depths?"
TOO_NOISY = "nearly all depths are beyond what is mapped (sensors.max_sigma): is their unit right?"
"""Remark on images of which hardly any depth is precise enough."""

NOT_OPTICAL = "z of the image's frame points up: an optical frame is expected (z forward, y down)"
"""Reasons of dropped images."""

LOST_FRACTION = 0.01
"""If a smaller fraction of an image's depths is within range, the unit is wrong."""

UPWARD = math.cos(math.pi / 4)
"""Minimum z of an upward axis of a body frame: cameras are not tilted by more than 45 deg."""


def rejection_reason(image: DepthImage, max_range: float = math.inf) -> str | None:
    """Return why an image is rejected; None if it is not.

    Parameters
    ----------
    image
        The image.
    max_range
        Maximum mapped depth, m.
    """
    fraction = _fraction_within(image, max_range)
    if fraction is None:
        return "no depths"
    is_in_mm = image.depth.dtype == np.uint16
    return (TOO_FAR_MM if is_in_mm else TOO_FAR) if fraction < LOST_FRACTION else None


def _fraction_within(image: DepthImage, limit: float) -> float | None:
    """Return the fraction of an image's depths up to a limit, m; None without depths."""
    is_in_mm = image.depth.dtype == np.uint16
    known = image.depth > 0 if is_in_mm else np.isfinite(image.depth) & (image.depth > 0.0)
    count = np.count_nonzero(known)
    within = known & (image.depth <= np.float32(1e3 * limit if is_in_mm else limit))
    return np.count_nonzero(within) / count if count else None


def remark(image: DepthImage, config: Config) -> str | None:
    """Return a remark on an unusual image that is used."""
    fraction = _fraction_within(image, max_mapped_depth(config))
    is_noisy = fraction is not None and fraction < LOST_FRACTION
    return image.remark or (TOO_NOISY if is_noisy else None)


def fault_of_pose(posed: Posed) -> str | None:
    """Return why the frame of an image is no optical frame; None if it may be.

    The y axis of a camera that looks up steeply points down; that of a body frame does not.
    """
    up_y, up_z = posed.T_base_sensor[0, 2, 1:3]
    return NOT_OPTICAL if up_z > UPWARD and up_y > -0.5 * UPWARD else None


def join_camera(
    image: Picture, cameras: Sequence[CameraInfo], is_last: bool
) -> Picture | str | None:
    """Return an image with its calibration: of equal stamp, or the newest of equal frame and size.

    Parameters
    ----------
    image
        The image.
    cameras
        The calibrations received.
    is_last
        Whether no better one will come.

    Returns
    -------
    The image with its calibration, or why there is none, or None if one may still come.
    """
    of_frame = [c for c in cameras if c.frame_id == image.frame_id]
    fitting = [c for c in of_frame if c.image_size == image.size]
    for camera in fitting:
        if camera.stamp_ns == image.stamp_ns:
            return _with_camera(image, camera)
    is_last = is_last or len(cameras) == 1 or any(c.stamp_ns > image.stamp_ns for c in of_frame)
    if not is_last:
        return None
    if fitting:
        before = [c for c in fitting if c.stamp_ns < image.stamp_ns]
        return _with_camera(image, before[-1] if before else fitting[0])
    if of_frame:
        return "image and camera info of different sizes"
    return "camera info of another frame" if cameras else "no camera info"


def _with_camera(image: Picture, camera: CameraInfo) -> Picture | str:
    """Return an image with its calibration, or why the calibration is unusable."""
    if isinstance(image, DepthImage) and image.is_rectified:
        camera = camera.rectified()
    return replace(image, camera=camera) if has_known_lens(camera) else "unknown distortion model"


def depth_reader(topic: str, *, compressed: bool | None = None) -> MessageReader:
    """Return the reader of the depth images on a topic.

    Parameters
    ----------
    topic
        Topic name, which tells whether the images are rectified.
    compressed
        Whether the images are compressed; by default, by the topic name.
    """
    packed = is_compressed(topic) if compressed is None else compressed
    reader = COMPRESSED_READER if packed else IMAGE_READER
    if not is_rectified(topic):
        return reader
    read = reader.of_message
    return MessageReader(
        reader.message_type,
        lambda message: [replace(image, is_rectified=True) for image in read(message)],
    )


def depth_stream(topic: str, config: Config | None = None) -> Stream:
    """Return the stream of the depth images on a topic, whose name is the role of the stream.

    The configuration gives `scan.max_range`. If the topic is remapped, use `depth_reader` with the
    resolved name.
    """
    config = config or Config()
    return Stream(
        role=topic,
        record=DepthImage,
        reader=depth_reader(topic),
        mount=MountKind.ANY,
        processor="tccm",
        event=PosedImage,
        rejection_reason=partial(rejection_reason, max_range=config.scan.max_range),
        remark=partial(remark, config=config),
        fault_of_pose=fault_of_pose,
        sees_robot=True,
        companion=Companion(camera_info_topic(topic), CameraInfo, CAMERA_INFO_READER, join_camera),
        max_waiting=MAX_WAITING,
    )


def max_mapped_depth(config: Config) -> float:
    """Return the depth at which the noise is `sensors.max_sigma`, m."""
    a, b, c = config.sensors.depth_sigma
    if b <= 0.0:
        return math.inf if a <= config.sensors.max_sigma else 0.0
    return c + math.sqrt(max(config.sensors.max_sigma - a, 0.0) / b)


def measure_image(posed: PosedImage, config: Config) -> MeasuredPoints:
    """Return the points of a depth image in odom, and a sample of its rays."""
    step = _pixel_steps(posed)[0]
    spacing = LINES_PER_COLUMN * config.views.reach * step
    every = max(int(config.views.cell_size / spacing), 1)
    max_z = min(max_mapped_depth(config), 1e6)
    measured = _measure(posed, config, max_z, 0.5 * config.map.cell_size, every)
    return in_region(measured, posed, config)


def seen_points(posed: PosedImage, config: Config) -> Float64:
    """Return all points of a depth image, float64 (N, 3), m, in odom, including noisy ones."""
    return _measure(posed, config, 1e6, 0.0, 0).points


def _pixel_steps(posed: PosedImage) -> tuple[float, float]:
    """Return the distances between neighbouring columns and rows at z = 1."""
    camera = posed.image.camera
    assert camera is not None
    return float(camera.binning[0] / camera.K[0, 0]), float(camera.binning[1] / camera.K[1, 1])


def _measure(
    posed: PosedImage, config: Config, max_z: float, half: float, every: int
) -> MeasuredPoints:
    """Return the points of an image without flying pixels and without the robot itself.

    Parameters
    ----------
    posed, config
        The posed image, and the parameters of noise and limits.
    max_z
        Maximum mapped depth, m.
    half
        Distance to which points are thinned, m.
    every
        Pixel step between traced rays; 0 for none.
    """
    image, camera = posed.image, posed.image.camera
    assert camera is not None
    rays = pixel_rays(camera)
    # Kernels are compiled for writable arrays only.
    depth = image.depth if image.depth.flags.writeable else image.depth.copy()
    steps = _pixel_steps(posed)
    a, b, c = config.sensors.depth_sigma
    slope = 1.0 / math.tan(MIN_SIGHT_ANGLE)
    edges = [slope * steps[0], slope * steps[1], EDGE_SIGMAS * a, EDGE_SIGMAS * b, c]
    limits = DepthLimits(
        unit=np.float32(0.001 if depth.dtype == np.uint16 else 1.0),
        max_depth=np.float32(config.scan.max_range),
        edges=np.array(edges, np.float32),
        max_z=np.float32(max_z),
        half=half,
        steps=steps,
    )
    sight = SightLines(every, np.array([PASSED_SIGMAS * a, PASSED_SIGMAS * b, c]))
    T = np.ascontiguousarray((posed.T_odom_base[0] @ posed.T_base_sensor[0])[:3])
    height, width = depth.shape
    points = np.empty((height * width, 3))
    room = (height // every + 1) * (width // every + 1) if every else 0
    ends, hits = np.empty((room, 3)), np.empty(room, np.bool_)
    n, lines = place_image(depth, rays, limits, sight, T, points, ends, hits)
    measured = MeasuredPoints(
        points=points[:n].copy(),
        stamps_ns=None,
        origins=np.broadcast_to(T[:, 3], (lines, 3)).copy(),
        ends=ends[:lines].copy(),
        hits=hits[:lines].copy(),
        line_angle=every * steps[0],
    )
    return without_robot(measured, posed, config)
