"""Make the bundled bags again: ``python bags/make_bags.py [FOLDER]``.

Each bag gets a README with its topics, its truth, the command that made it and its checksum. On
one machine the same bytes come out every time; another processor's mathematics library may round a
last digit otherwise, so a checksum says that a file is whole, not that it can be made again.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from tccm_sim.bundled import DEMO
from tccm_sim.options import Options
from tccm_sim.recording import simulate


class Bundled(NamedTuple):
    """One bag: its name, its world, seed, options, and what it shows."""

    name: str
    world: str
    seed: int
    options: Options
    about: str


BAGS = (
    Bundled(
        "flat",
        "flat",
        1,
        Options(),
        "A kitchen and a living room, driven through by a robot like that of the surface mapping "
        "paper (level LMS 291, UTM-30LX on a pan-tilt unit) that stops at eight places for one "
        "sweep each. A person passes during the fourth sweep.",
    ),
    Bundled(
        "rgbd_kitchen",
        "rgbd_kitchen",
        1,
        Options(),
        "The kitchen of `flat`, seen by a depth camera on the head of a robot with the frames, "
        "joints and topics of Fetch, which stops six times to look around: compressed depth images "
        "at 2 Hz, and a level laser that hangs upside down. The robot's arm is in the camera's "
        "view.",
    ),
    Bundled(
        "office_signs",
        "office_signs",
        1,
        Options(tilt_beams=541),
        "Ten offices on a corridor, each with a door sign beside its door, between posters, "
        "notices and lists that are none. A robot like that of `flat`, with a camera that looks to "
        "the left, drives along the corridor, looks into the five rooms on its left, scans in two "
        "of them, and drives back.",
    ),
    Bundled(
        "upside_down",
        "upside_down",
        1,
        Options(),
        "A small room with a table. The tilting laser hangs upside down and its joint turns the "
        "other way; topics, frames and joints have other names; the base frame is 0.12 m above "
        "the floor and the odometry does not start at zero. The robot scans while it drives, "
        "too. Replay it with `--remap tilt_scan:=/nod_lidar/scan "
        "--remap scan:=/front_lidar/scan --remap joint_states:=/dynamixel/joint_states "
        "--remap odom:=/wheel_odom`.",
    ),
    Bundled(
        "walkthrough",
        "walkthrough",
        1,
        Options(),
        "A table 0.5 m ahead of a standing robot like that of the TCCM paper (tilt axis at 1.52 m, "
        "sweeps of 1.575 s). A person walks past (3 to 7 s), a box leaves the table (8 s), another "
        "appears (11 s), and a stool is carried away (13 to 16 s).",
    ),
)


def make(bundled: Bundled, folder: Path) -> None:
    """Simulate one bag into a folder and describe it."""
    path = simulate(
        bundled.world,
        folder / bundled.name,
        seed=bundled.seed,
        options=bundled.options,
        overwrite=True,
    )
    (path / "README.md").write_text(_readme(bundled, path), encoding="utf-8")


def make_demo(target: Path) -> None:
    """Simulate the recording of `tccm demo`: the flat with a beam every 0.75 deg, at most 3 MB."""
    with tempfile.TemporaryDirectory() as folder:
        made = simulate("flat", Path(folder) / "flat", seed=1, options=Options(tilt_beams=361))
        shutil.copyfile(made / "flat.mcap", target)


def _readme(bundled: Bundled, path: Path) -> str:
    information = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
    bag: dict[str, Any] = information["rosbag2_bagfile_information"]
    truth = json.loads((path / "truth.json").read_text(encoding="utf-8"))
    settings = bundled.options.model_dump(exclude_defaults=True)
    options = "".join(f" --set {key}={value}" for key, value in settings.items())
    lines = [
        f"# {bundled.name}",
        "",
        f"{bundled.about} Simulated; {bag['duration']['nanoseconds'] * 1e-9:.1f} s.",
        "",
        f"Made by `tccm simulate {bundled.world} {bundled.name} --seed {bundled.seed}{options}` "
        "(all bags: `python bags/make_bags.py`).",
        "",
        "| topic | type | messages |",
        "|---|---|---|",
    ]
    for topic in sorted(
        bag["topics_with_message_count"], key=lambda t: t["topic_metadata"]["name"]
    ):
        about = topic["topic_metadata"]
        lines.append(f"| {about['name']} | {about['type']} | {topic['message_count']} |")
    lines += [
        "",
        "Truth, exact, in the map frame (the first base pose, levelled): `truth.json` has the "
        "surfaces at the end of the recording (keys of surfaces.json; `gone`: what left before; "
        "`others`: smaller or hidden tops; `objects`: what stands on them), `truth.tum` the "
        "trajectory of the base, `truth_walls.json` the walls.",
        *_signs(truth),
        "",
        "| surface | height, m | area, m2 |",
        "|---|---|---|",
        *(f"| {s['label']} | {s['height']:.3f} | {s['area']:.3f} |" for s in truth["surfaces"]),
        "",
        "| file | sha256 |",
        "|---|---|",
    ]
    for file in sorted(path.iterdir()):
        if file.name != "README.md":
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            lines.append(f"| {file.name} | {digest} |")
    return "\n".join(lines) + "\n"


def _signs(truth: dict[str, Any]) -> list[str]:
    """Return the lines about door signs, where there are some."""
    if "signs" not in truth:
        return []
    return [
        "",
        "`signs` of `truth.json` are the door signs (text, position of the number, normal of the "
        "wall, room), `rooms` the boundaries of the rooms.",
        "",
        "| sign | x, m | y, m | z, m |",
        "|---|---|---|---|",
        *(
            f"| {s['text']} | {' | '.join(f'{v:.3f}' for v in s['position'])} |"
            for s in truth["signs"]
        ),
    ]


def main() -> None:
    """Make all bags beside this file, or in the folder that is named."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for bundled in BAGS:
        make(bundled, folder)
        print(f"{folder / bundled.name}: made")
    demo = folder / DEMO.name if len(sys.argv) > 1 else DEMO
    make_demo(demo)
    print(f"{demo}: made")


if __name__ == "__main__":
    main()
