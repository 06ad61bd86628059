"""Depth images of 640 x 480 pixels, from raw bytes to a part map, against OctoMap and PCL.

    python bench/bench_sensors.py [--images 30]

The camera is on the head of a robot that stands at a worktop and looks around, and that stands in
the room (`depth_kitchen`); the robot's own arm is in view and filtered out. A cycle is one second
of images; each image carries its part of closing the part map. OctoMap inserts the points of the
same images with ray casting, at the map's cell size: those left after thinning, and all. PCL thins
all points by VoxelGrid to half a cell and looks for one plane among the rest by RANSAC.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from bench_tccm import Table, median_ms
from depth_kitchen import SCAN, STANDS, samples
from numpy.typing import NDArray
from plane_scenes import pcl_voxels
from tccm_peers import find_octomap

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.config import Config
from tccm_ros.cuboids.cycle_records import CyclePoints
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.robot import Robot
from tccm_ros.sensors.depth_image import PosedImage, measure_image, seen_points
from tccm_ros.sensors.depth_messages import IMAGE_READER
from tccm_ros.sensors.registry import default_streams
from tccm_sim.sensor_messages import depth_image_message

RATE = 30.0
TRIALS = 1000

STEPS = "read bytes", "points and lines of sight", "bin", "close, its part"


def posed_images(stand: str, n: int) -> list[PosedImage]:
    """Return the first images of a stand, each with its poses and the robot's shapes."""
    robot, found = Robot(Config(), default_streams(), expects_odometry=True), []
    for _, topic, record in samples(stand, RATE, n / RATE + 0.5):
        if topic != SCAN:
            found += [e for e in robot.add(topic, record) if isinstance(e, PosedImage)]
    return found[:n]


def steps_ms(posed: Sequence[PosedImage]) -> dict[str, float]:
    """Return the time of each step of an image, ms."""
    config, types, numbers = Config(), TypestoreMessages(), iter(range(10**9))
    n, builder = len(posed), PartMapBuilder(config)
    raw = [
        bytes(types.serialize("sensor_msgs/msg/Image", depth_image_message(types, p.image)))
        for p in posed
    ]
    records = [CyclePoints(p, measure_image(p, config)) for p in posed]

    def bin_all() -> None:
        for record in records:
            record.bin(builder)

    return dict(
        zip(
            STEPS,
            (
                median_ms(
                    lambda: IMAGE_READER.read(bytearray(raw[next(numbers) % n]), types.deserialize),
                    100,
                ),
                median_ms(lambda: measure_image(posed[next(numbers) % n], config), 100),
                median_ms(bin_all, 5, builder.clear) / n,
                median_ms(lambda: builder.close(0, 0, 1), 5, bin_all) / n,
            ),
            strict=True,
        )
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=30, help="of a cycle")
    n = parser.parse_args().images
    for stand in STANDS:
        posed = posed_images(stand, n)
        kept = [len(measure_image(p, Config()).points) for p in posed]
        pixels = posed[0].image.depth.size
        print(
            f"\n### {stand[0].upper()}{stand[1:]}: {np.mean(kept):.0f} of {pixels} pixels are kept "
            f"({min(kept)} to {max(kept)})\n"
        )
        times = steps_ms(posed)
        whole = sum(times.values())
        table = Table("step", "ms an image", "ratio")
        for name, each in times.items():
            table.row(name, f"{each:.2f}", f"{each / whole:.2f}")
        table.row("raw bytes to part map", f"{whole:.2f}", "1")
        peers(table, posed[:1], whole)


def peers(table: Table, posed: Sequence[PosedImage], whole: float) -> None:
    """Add the rows of OctoMap and PCL on the same image."""
    config = Config()
    thinned: list[NDArray[np.float64]] = [measure_image(p, config).points for p in posed]
    everything = [seen_points(p, config) for p in posed]
    made = find_octomap(None)
    if made is None:
        table.row("OctoMap", "not installed", "")
    else:
        peer, T = made(config.map.cell_size), posed[0].T_odom_base[0] @ posed[0].T_base_sensor[0]
        for what, points in (("the kept points", thinned[0]), ("all points", everything[0])):
            xyz = np.ascontiguousarray(points, np.float32)
            ms = median_ms(lambda xyz=xyz: peer.rays(xyz, tuple(T[:3, 3])), 3, peer.clear)
            table.row(f"{peer.name}, insertPointCloud of {what}", f"{ms:.1f}", f"{ms / whole:.0f}")
    found = pcl_voxels(everything, 0.5 * config.map.cell_size, TRIALS)
    if found is None:
        table.row("PCL", "not installed", "")
        return
    grid, ransac, left, _ = np.median(found[0], axis=0)
    table.row("PCL, VoxelGrid of all points", f"{grid:.1f}", f"{grid / whole:.1f}")
    table.row(
        f"PCL, one plane of the {left:.0f} points left, by RANSAC", f"{ransac:.1f}",
        f"{ransac / whole:.1f}",
    )  # fmt: skip


if __name__ == "__main__":
    main()
