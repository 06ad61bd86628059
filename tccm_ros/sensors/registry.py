"""The built-in sensors; a new one is a module of this folder and a line here."""

from __future__ import annotations

from dataclasses import replace

from tccm_ros.config import Config
from tccm_ros.records import CameraImage, DepthImage
from tccm_ros.robot import Stream
from tccm_ros.sensors.camera_image import camera_stream, is_compressed_picture
from tccm_ros.sensors.depth_image import depth_reader, depth_stream
from tccm_ros.sensors.detections import detections_stream
from tccm_ros.sensors.laser_scan import LEVEL_SCAN, TILT_SCAN, scan_stream
from tccm_ros.sensors.point_cloud import cloud_stream


def default_streams(config: Config | None = None) -> tuple[Stream, ...]:
    """Return the streams of the configured sensors; a caller may add others."""
    config = config or Config()
    sensors = config.sensors
    # Level scans from the only cloud move the base like those of a laser.
    is_base = sensors.level_from == "points" and len(sensors.point_clouds) == 1
    return (
        *(scan_stream(replace(TILT_SCAN, role=topic), config) for topic in sensors.tilt_scans),
        scan_stream(LEVEL_SCAN, config),
        *(depth_stream(topic, config) for topic in sensors.depth_images),
        *(cloud_stream(topic, config, can_be_base=is_base) for topic in sensors.point_clouds),
        *map(detections_stream, sensors.detections),
        *map(camera_stream, sensors.camera_images if config.signs.enabled else ()),
    )


def stream_for_topic(stream: Stream, topic: str) -> Stream:
    """Return a stream with the message reader for a topic, by the topic's name.

    Parameters
    ----------
    stream
        A stream of `default_streams`.
    topic
        Resolved name; for images, it tells whether they are compressed.
    """
    if stream.record is CameraImage:
        return camera_stream(stream.role, compressed=is_compressed_picture(topic))
    if stream.record is DepthImage:
        return replace(stream, reader=depth_reader(topic))
    return stream


def roles_of(processor: str, config: Config) -> frozenset[str]:
    """Return the roles of the streams of a processor (`Stream.processor`)."""
    return frozenset(
        stream.role for stream in default_streams(config) if stream.processor == processor
    )
