"""Run every benchmark, one after the other: `make bench`, or `python bench/run.py [NAME ...]`.

Each is also a command of its own. Here those that take long run in short (`IN_SHORT`), so that all
of them take a quarter of an hour; figures of the documentation come from the commands beside them.
Tables are Markdown; times are of this machine in this run, and what counts are the ratios to the
peers in the same run. The numbers of all tables are written to
`bench/results.json` with machine and versions; `bench/compare.py` holds two such files against each
other. A peer that is not installed is named before, with the line that installs it.
"""

import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

from tables import values_of
from tccm_peers import find_octomap

HERE = Path(__file__).resolve().parent
os.environ.setdefault("TCCM_STRICT", "1")  # a stage that fails is a fault
RESULTS = HERE / "results.json"
IN_SHORT = {
    "bench_catalogue": ("--maps", "1000"),
    "bench_changes": ("--sequences", "1"),
    "bench_degenerate": ("--seeds", "1"),
    "bench_growth": ("--keyframes", "1000"),
    "bench_live": ("ring",),
    "bench_merge": ("flat",),
    "bench_planes": ("--tests", "3"),
    "bench_pose": ("--names", "turtlebot4", "robocup2026_1"),
    "bench_question_latency": ("--answers", "30"),
    "bench_replay": (str(HERE.parent / "bags" / "flat"),),
    "bench_rooms": ("4",),
    "bench_sensors": ("--images", "10"),
    "bench_sign_map": ("--seeds", "1"),
    "bench_slam": ("--seeds", "2"),
    "bench_tccm": ("--repeats", "20"),
}
"""Arguments by benchmark; the others take theirs."""

PACKAGES = ("tccm_ros", "numpy", "numba", "scipy", "gtsam", "shapely", "rosbags", "mcap")


def missing_peers() -> dict[str, str]:
    """Return the peers that are not installed, and the line that installs each."""
    from_index = "pip install -r requirements-bench.txt"
    peers = {
        "the C++ twin of the TCCM": (shutil.which("g++"), "apt install g++"),
        "OctoMap": (
            find_octomap(None),
            f"apt install g++ liboctomap-dev, or {from_index}",
        ),
        "PCL": (
            shutil.which("g++") and any(Path("/usr/include").glob("pcl-*")),
            "apt install g++ libpcl-dev",
        ),
        "Open3D": (importlib.util.find_spec("open3d"), from_index),
    }
    return {name: line for name, (found, line) in peers.items() if not found}


def machine() -> dict[str, object]:
    """Return what the numbers depend on: processor, versions of Python and of packages."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def run(path: Path) -> tuple[dict[str, object], bool]:
    """Run a benchmark, showing what it prints; return its numbers and whether it succeeded."""
    arguments = IN_SHORT.get(path.stem, ())
    print(f"\n## {' '.join((path.stem, *arguments))}\n", flush=True)
    start, lines = time.monotonic(), []
    command = [sys.executable, str(path), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        for line in child.stdout or ():
            print(line, end="", flush=True)
            lines.append(line)
    seconds = time.monotonic() - start
    print(f"\n({seconds:.0f} s)", flush=True)
    values = [asdict(value) for value in values_of("".join(lines))]
    result = {"arguments": arguments, "seconds": round(seconds, 1), "values": values}
    return result, child.returncode == 0


def main(names: list[str]) -> int:
    """Run them; return how many failed."""
    known = {path.stem: path for path in sorted(HERE.glob("bench_*.py"))}
    unknown = sorted(set(names) - set(known))
    if unknown:
        print(f"no benchmark {unknown[0]}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    for peer, line in missing_peers().items():
        print(f"{peer} is not installed, its rows will be empty: {line}")
    results, failed = {}, 0
    for name in names or known:
        results[name], succeeded = run(known[name])
        failed += not succeeded
    content = {"machine": machine(), "benchmarks": results}
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")
    print(f"\n{sum(r['seconds'] for r in results.values()):.0f} s; numbers in {RESULTS}")
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
