"""Surfaces on the poses of another program: recordings with map -> odom on /tf.

    python bench/bench_external_poses.py bags/flat
    python bench/bench_external_poses.py bags/flat --sigma 0.03 1.0 --jump 0.3

The other program is made of the truth: map -> odom at 10 Hz, each with noise of its own (m, deg),
and the covariance of the noise on a topic.
With a jump, the poses of 10 s in the middle of the drive are moved by that distance. The recording
is replayed as it is, and with ``localisation.source=tf``.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.bags.reader import BagReader
from tccm_ros.bags.writer import BagWriter
from tccm_ros.config.reader import read_config
from tccm_ros.evaluate.surfaces import SurfaceScore, score_surfaces
from tccm_ros.geometry import inverse, planar, spatial
from tccm_ros.records import Odometry, TransformSample
from tccm_ros.replay.replay import replay
from tccm_ros.results.trajectory import read_tum
from tccm_ros.ros.output_messages import pose_covariance_message
from tccm_ros.ros.writing import transforms_message

PERIOD_NS = 100_000_000
"""Between two transforms, ns."""

JUMP_NS = 10_000_000_000
"""For so long the other program is wrong, ns."""


def write_localisation(
    bag: Path, out: Path, sigma: tuple[float, float], jump: float, seed: int = 0
) -> None:
    """Write map -> odom on /tf and its covariance, as another program publishes them.

    Parameters
    ----------
    bag
        A recording with odometry and ``truth.tum``.
    out
        An .mcap file.
    sigma
        Standard deviation of each pose, m and rad.
    jump
        Distance, m, by which the poses of `JUMP_NS` in the middle are moved.
    seed
        Of the noise.
    """
    rng = np.random.default_rng(seed)
    truth = read_tum(bag / "truth.tum")
    stamps, poses = truth.stamps_ns, truth.T_map_base
    half = stamps[len(stamps) // 2]
    last = -PERIOD_NS
    with BagReader(bag) as reader, BagWriter(out) as writer:
        for _, _, record in reader.records({"odom": "/odom"}):
            if not isinstance(record, Odometry) or record.stamp_ns < last + PERIOD_NS:
                continue
            i = int(np.searchsorted(stamps, record.stamp_ns))
            if i >= len(stamps) or abs(int(stamps[i]) - record.stamp_ns) > PERIOD_NS:
                continue
            last = record.stamp_ns
            noise: Float64 = rng.normal(size=3) * [sigma[0], sigma[0], sigma[1]]
            pose = planar(poses[i]) + noise
            pose[0] += jump * (half <= record.stamp_ns < half + JUMP_NS)
            T_map_odom = spatial(pose) @ inverse(record.T_odom_base)
            sample = TransformSample(last, "map", record.frame_id, T_map_odom, False)
            message = transforms_message(writer.types, [sample])
            writer.write("/tf", "tf2_msgs/msg/TFMessage", last, message)
            if min(sigma) > 0.0:
                cov = np.diag(np.square([sigma[0], sigma[0], sigma[1]]))
                message = pose_covariance_message(writer.types, last, "map", spatial(pose), cov)
                kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
                writer.write("/external_pose", kind, last, message)


def row(name: str, score: SurfaceScore, surfaces: int) -> str:
    """Return a row of the table."""
    overlaps = [m.overlap for m in score.matches]
    return (
        f"| {name} | {score.found} of {len(score.matches)} | {np.mean(overlaps):.3f} | "
        f"{len(score.false)} | {surfaces} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", nargs="+", type=Path, help="recordings with truth")
    parser.add_argument("--sigma", nargs=2, type=float, default=[0.03, 1.0], help="m, deg")
    parser.add_argument("--jump", type=float, default=0.0, help="m")
    chosen = parser.parse_args()
    sigma = chosen.sigma[0], float(np.radians(chosen.sigma[1]))
    print("| recording | found | mean overlap | false | surfaces |")
    print("|---|---|---|---|---|")
    for bag in chosen.bag:
        with tempfile.TemporaryDirectory() as folder:
            told = Path(folder) / "localisation.mcap"
            write_localisation(bag, told, sigma, chosen.jump)
            for name, bags, settings in (
                (bag.name, [bag], []),
                (f"{bag.name}, told", [bag, told], ["localisation.source=tf"]),
            ):
                out = Path(folder) / name
                replay(bags, out, read_config(None, settings), pictures=False)
                surfaces = json.loads((out / "surfaces.json").read_text())["surfaces"]
                score = score_surfaces(out / "surfaces.json", bag / "truth.json")
                print(row(name, score, len(surfaces)), flush=True)


if __name__ == "__main__":
    main()
