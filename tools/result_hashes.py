"""Print the SHA-256 of what a replay writes, for every bundled bag and every recording at hand.

    python tools/result_hashes.py [--data FOLDER] [--only NAME ...] > hashes.txt

Run it before and after a change that should not alter results, and compare the two files with
diff. A line is `recording file sha256`. CARMEN logs are imported first.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

FILES = (
    "trajectory.tum",
    "surfaces.json",
    "walls.json",
    "planes.json",
    "objects.json",
    "cuboids.npz",
)
"""The files whose numbers may not change unless a change says so."""

BUNDLED = ("flat", "rgbd_kitchen", "upside_down", "walkthrough")

REMAPPED = {
    "upside_down": (
        "tilt_scan:=/nod_lidar/scan",
        "scan:=/front_lidar/scan",
        "joint_states:=/dynamixel/joint_states",
        "odom:=/wheel_odom",
    ),
}
"""Topics of recordings that have other names."""


def tccm(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line of this checkout."""
    command = [sys.executable, "-m", "tccm_ros.cli", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def recordings(data: Path) -> dict[str, Path]:
    """Return the recordings by name: bundled bags, rosbag2 folders and CARMEN logs."""
    found = {name: ROOT / "bags" / name for name in BUNDLED}
    found.update({path.name: path for path in sorted((data / "bags").glob("*")) if path.is_dir()})
    found.update({path.name: path for path in sorted((data / "carmen").glob("*.clf.bz2"))})
    return found


def hashes(path: Path, folder: Path) -> list[tuple[str, str]]:
    """Replay one recording into a folder; return the file names with their SHA-256."""
    bag = path
    if path.name.endswith(".clf.bz2"):
        bag = folder / "imported"
        imported = tccm("import-carmen", str(path), str(bag))
        if imported.returncode:
            return [("import", f"failed: {imported.stderr.strip()}".replace(str(path.parent), ""))]
    remaps = [word for topic in REMAPPED.get(path.name, ()) for word in ("--remap", topic)]
    done = tccm("replay", str(bag), "--out", str(folder / "out"), *remaps)
    if done.returncode:
        return [("replay", f"failed: {done.stderr.strip()}".replace(str(path.parent), ""))]
    rows = []
    for name in FILES:
        file = folder / "out" / name
        content = hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else "none"
        rows.append((name, content))
    return rows


def main() -> None:
    """Print a line for each result file of each recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--only", nargs="*", default=None, help="names of recordings")
    arguments = parser.parse_args()
    for name, path in recordings(arguments.data).items():
        if arguments.only is not None and name not in arguments.only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            for file, content in hashes(path, Path(folder)):
                print(name, file, content, flush=True)


if __name__ == "__main__":
    main()
