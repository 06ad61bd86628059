"""Log posed sensor records to Rerun, thinned."""

from __future__ import annotations

import io

import numpy as np
import rerun as rr
from PIL import Image

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import Posed, PosedScan
from tccm_ros.report import palette
from tccm_ros.sensors.depth_image import PosedImage
from tccm_ros.sensors.laser_scan import project, used_beams
from tccm_ros.sensors.point_cloud import PosedCloud
from tccm_ros.view.rerun_shapes import BASE, ODOM, RADIUS_M, log_pose, rgb, set_stamp

MAX_IMAGE_WIDTH = 320
"""Maximum width of depth images after thinning, pixels: a megapixel a second fills a disk."""

MAX_POINTS = 20_000
"""Maximum number of points of a cloud after thinning. Chosen: it is still recognisable."""


class SensorLog:
    """Logs scans in the odometry frame, and depth images and clouds in that of their sensor.

    The caller logs the poses of `ODOM` and `BASE`.

    Parameters
    ----------
    config
        Configuration of the robot and its sensors.
    stream
        Output stream.

    Attributes
    ----------
    stream
        Output stream.
    cameras
        Roles of the depth cameras so far.
    """

    def __init__(self, config: Config, stream: rr.RecordingStream):
        self._config, self.stream = config, stream
        self._sensors: dict[str, Posed] = {}
        self.cameras: list[str] = []

    def add(self, event: Posed) -> None:
        """Log a record at its stamp."""
        set_stamp(self.stream, event.stamp_ns)
        if isinstance(event, PosedScan):
            points, _ = project(event, used_beams(event, self._config))
            self._points(f"{ODOM}/{event.role}", points)
        elif isinstance(event, PosedImage):
            self._image(event)
        elif isinstance(event, PosedCloud):
            self._place_sensor(event)
            points = event.record.points
            step = -(-len(points) // MAX_POINTS) or 1
            self._points(f"{BASE}/{event.role}", points[::step])

    def _points(self, entity: str, points: Float64) -> None:
        near = np.asarray(points, np.float32)
        self.stream.log(entity, rr.Points3D(near, radii=RADIUS_M, colors=rgb(palette.VIEW)))

    def _place_sensor(self, event: Posed) -> None:
        """Log the pose of a sensor on the base if it has changed."""
        before = self._sensors.get(event.role)
        if before is None or not np.array_equal(before.T_base_sensor[0], event.T_base_sensor[0]):
            log_pose(self.stream, f"{BASE}/{event.role}", event.T_base_sensor[0])
            self._sensors[event.role] = event

    def _image(self, event: PosedImage) -> None:
        """Log a depth image as a PNG in mm, and its camera."""
        image, entity = event.image, f"{BASE}/{event.role}"
        self._place_sensor(event)
        step = -(-image.depth.shape[1] // MAX_IMAGE_WIDTH)
        depth = image.depth[::step, ::step]
        if depth.dtype != np.uint16:
            known = np.isfinite(depth) & (depth > 0.0)
            depth = np.where(known, np.clip(depth * 1e3, 0, 65535), 0).astype(np.uint16)
        height, width = depth.shape
        if image.camera is not None and event.role not in self.cameras:
            matrix = image.camera.P[:, :3] if image.is_rectified else image.camera.K
            K = np.diag([1.0 / step, 1.0 / step, 1.0]) @ matrix
            pinhole = rr.Pinhole(
                image_from_camera=K,
                resolution=[width, height],
                camera_xyz=rr.ViewCoordinates.RDF,
            )
            self.stream.log(entity, pinhole, static=True)
            self.cameras.append(event.role)
        packed = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(depth)).save(packed, "PNG", compress_level=1)
        encoded = rr.EncodedDepthImage(blob=packed.getvalue(), media_type="image/png", meter=1000.0)
        self.stream.log(f"{entity}/depth", encoded)
