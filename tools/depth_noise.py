"""Write the table of noise in docs/guides/depth_camera.md: ``python tools/depth_noise.py``."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.sensors.depth_image import max_mapped_depth

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "guides" / "depth_camera.md"
FOCAL = 320.0 / np.tan(np.deg2rad(29.0))  # px, of 640 px over 58 deg


def sigma(config: Config, depth: float) -> float:
    """Return the standard deviation of a depth, both in m."""
    a, b, c = config.sensors.depth_sigma
    return a + b * (depth - c) ** 2


def table() -> str:
    """Return the rows for the default and for a stereo camera."""
    cameras = Config(), read_config(ROOT / "config" / "robots" / "stretch.yaml")
    rows = []
    for depth in (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0):
        noise = " | ".join(f"{1000 * sigma(config, depth):.1f}" for config in cameras)
        rows.append(f"| {depth:.1f} | {noise} | {1000 * depth / FOCAL:.1f} |")
    limits = " | ".join(f"{max_mapped_depth(config):.2f} m" for config in cameras)
    return "\n".join([*rows, f"| mapped up to | {limits} | |"])


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    head = r"(\| depth, m \|.*\n\|---.*\n)"
    PAGE.write_text(re.sub(head + r"(?:\|.*\n)*", r"\1" + table() + "\n", text), encoding="utf-8")
