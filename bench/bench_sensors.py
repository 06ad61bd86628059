"""Depth images of 640 x 480 pixels, from raw bytes to a part map, against OctoMap and PCL.

    python bench/bench_sensors.py [--images 30]

A head camera 1.5 m high looks at a worktop with boxes on it before a wall, and pans. A cycle is one
second of images; each image carries its part of closing the part map. OctoMap inserts the points
of the same images that are left after thinning, with ray casting, at the map's cell size; PCL looks
for one plane among them by RANSAC.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from bench_tccm import median_ms
from numpy.typing import NDArray
from plane_scenes import pcl_planes
from tccm_peers import find_octomap

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.cuboids.cycle_records import CyclePoints
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import CameraInfo, DepthImage
from tccm_ros.ros.writing import depth_image_message
from tccm_ros.sensors.depth_image import PosedImage, measure_image
from tccm_ros.sensors.depth_messages import IMAGE_READER

WIDTH, HEIGHT, FOCAL = 640, 480, 525.0
K = np.array([[FOCAL, 0.0, 319.5], [0.0, FOCAL, 239.5], [0.0, 0.0, 1.0]])
CAMERA = CameraInfo(
    0, "eye", WIDTH, HEIGHT, "plumb_bob", np.zeros(5), K, np.hstack([K, np.zeros((3, 1))])
)
BOXES = (
    ((-9.0, 9.0), (-9.0, 9.0), (-1.0, 0.0)),  # floor
    ((1.9, 2.5), (-9.0, 9.0), (0.0, 9.0)),  # wall
    ((1.0, 1.9), (-1.6, 1.6), (0.0, 0.92)),  # worktop
    ((1.3, 1.5), (-0.5, -0.3), (0.92, 1.1)),
    ((1.4, 1.6), (0.2, 0.5), (0.92, 1.05)),
)
"""x, y and z of what stands in the kitchen, m."""

NOISE = 0.0012, 0.0019, 0.4
"""a, b and c of the noise a + b (z - c)^2, m."""


def poses(n: int) -> list[NDArray[np.float64]]:
    """Return T_odom_camera of a panning head, looking down by 35 deg."""
    optical = pose_from_rpy([0, 0, 0, -np.pi / 2, 0, -np.pi / 2])
    pans = 0.3 * np.sin(np.linspace(0.0, 2.0, n))
    return [pose_from_rpy([0, 0, 1.5, 0, 0.61, pan]) @ optical for pan in pans]


def depths(T: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint16]:
    """Return the depth image of the kitchen, mm."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(u - K[0, 2]) / FOCAL, (v - K[1, 2]) / FOCAL, np.ones(u.shape)], axis=-1)
    way, origin = rays @ T[:3, :3].T, T[:3, 3]
    nearest = np.full(u.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for box in BOXES:
            low, high = np.array(box)[:, 0], np.array(box)[:, 1]
            a, b = (low - origin) / way, (high - origin) / way
            enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            nearest = np.where((enter < leave) & (enter > 0), np.minimum(nearest, enter), nearest)
    nearest += rng.normal(size=u.shape) * (NOISE[0] + NOISE[1] * (nearest - NOISE[2]) ** 2)
    return np.where(nearest < 5.0, np.rint(1e3 * nearest), 0.0).astype(np.uint16)


def messages(views: list[NDArray[np.float64]]) -> Iterator[bytes]:
    """Yield the serialised images."""
    types, rng = TypestoreMessages(), np.random.default_rng(0)
    for k, T in enumerate(views):
        image = DepthImage(k * 33_333_333, "eye", depths(T, rng))
        yield bytes(types.serialize("sensor_msgs/msg/Image", depth_image_message(types, image)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=30, help="of a cycle")
    n = parser.parse_args().images
    config, types, views = Config(), TypestoreMessages(), poses(n)
    raw = list(messages(views))
    base = np.eye(4)[None]

    def read(k: int) -> PosedImage:
        (image,) = IMAGE_READER.read(bytearray(raw[k]), types.deserialize)
        image = DepthImage(image.stamp_ns, image.frame_id, image.depth, CAMERA)
        return PosedImage(image, np.array([image.stamp_ns]), base, views[k][None], role="depth")

    posed = [read(k) for k in range(n)]
    records = [CyclePoints(p, measure_image(p, config)) for p in posed]
    points = [np.ascontiguousarray(r.measured.points, np.float32) for r in records]
    builder, numbers = PartMapBuilder(config), iter(range(10**9))

    def bin_all() -> None:
        for record in records:
            record.bin(builder)

    rows = {
        "read bytes": median_ms(lambda: read(next(numbers) % n), 100),
        "points and lines of sight": median_ms(
            lambda: measure_image(posed[next(numbers) % n], config), 100
        ),
        "bin": median_ms(bin_all, 5, builder.clear) / n,
        "close, its part": median_ms(lambda: builder.close(0, 0, 1), 5, bin_all) / n,
    }
    whole = sum(rows.values())
    kept = sum(map(len, points)) / n
    print(f"{kept:.0f} of {WIDTH * HEIGHT} pixels are kept\n\n| step | ms an image | ratio |")
    print("|---|---|---|")
    for name, ms in rows.items():
        print(f"| {name} | {ms:.2f} | {ms / whole:.2f} |")
    print(f"| **raw bytes to part map** | **{whole:.2f}** | 1 |")
    made = find_octomap(None)
    if made is None:
        print("| OctoMap | not installed | |")
    else:
        peer = made(config.map.cell_size)
        origin = tuple(views[0][:3, 3])
        ms = median_ms(lambda: peer.rays(points[0], origin), 3, peer.clear)
        print(f"| {peer.name}, insertPointCloud of the kept points | {ms:.1f} | {ms / whole:.0f} |")
    planes = pcl_planes([points[0].astype(float)], 1000)
    if planes is None:
        print("| PCL | not installed | |")
    else:
        ms = float(planes[0][0, 0])
        print(f"| PCL, one plane of the kept points by RANSAC | {ms:.1f} | {ms / whole:.1f} |")


if __name__ == "__main__":
    main()
