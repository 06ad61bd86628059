"""Does the check of the rig name what is wrong, and is it silent where nothing is?

python bench/rig_check_trials.py [--bags BAG ...]

A simulated robot maps as it does live, cycle by cycle, and `RigCheck` is asked after each. Printed
is for each trial how many cycles there were, after how many the right name came first, in how many
of the cycles after that it did, and what else was said. With ``--bags`` recordings are looked at
instead: as they are, and with the rig that `calibrate` finds for them.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.calibrate.calibration import calibrate
from tccm_ros.calibrate.rig_check import RigCheck
from tccm_ros.config import Config
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_sim.options import Options
from tccm_sim.recording import run

DEG = float(np.deg2rad(1.0))

IN_THE_WAY = {"clutter": 40, "ramp": True, "people": True}

#: What is simulated, and the name that must come first (None: nothing must be said).
TRIALS: dict[str, tuple[dict[str, object], str | None]] = {
    "right rig": ({}, None),
    "right rig, second seed": ({"seed": 1}, None),
    "right rig, clutter, ramp, person": (IN_THE_WAY, None),
    "right rig, scans while driving": ({"always": True}, None),
    "right rig, base tilted by 0.14 deg": ({"base_tilt": 2.0}, None),
    "right rig, slow tilt cycles": ({"cycle_period": 4.0}, None),
    "right rig, world flat": ({"world": "flat"}, None),
    "right rig, world moved": ({"world": "moved"}, None),
    **{
        f"delay {ms:+d} ms": ({"joint_time_offset": 1e-3 * ms}, "delay")
        for ms in (-50, -20, -10, -5, 5, 10, 20, 50)
    },
    **{
        f"zero {deg:+.1f} deg": ({"tilt_offset": deg * DEG}, "tilt zero")
        for deg in (-2.0, -0.7, -0.3, 0.3, 0.7, 2.0)
    },
    **{
        f"scale {percent:+d} %": ({"tilt_scale": 1.0 + 0.01 * percent}, "tilt scale")
        for percent in (-4, -2, -1, 1, 2, 4)
    },
    **{f"roll {deg:+.1f} deg": ({"laser_roll": deg * DEG}, "roll") for deg in (-1.0, 0.7)},
    "odometry turns by 0.05 rad/m": ({"heading_drift": 0.05, "always": True}, "doubled surface"),
    "odometry errs 20 times": ({"odometry": 20.0, "always": True}, "doubled surface"),
    "delay 20 ms, clutter, ramp, person": (IN_THE_WAY | {"joint_time_offset": 0.02}, "delay"),
    "zero 0.7 deg, clutter, ramp, person": (IN_THE_WAY | {"tilt_offset": 0.7 * DEG}, "tilt zero"),
    "scale -4 %, clutter, ramp, person": (IN_THE_WAY | {"tilt_scale": 0.96}, "tilt scale"),
}


def simulated(options: dict[str, object]) -> list[list[tuple[str, float]]]:
    """Return what was said after each cycle: names and sizes, the first first."""
    usual = {"tilt_beams": 181, "cycle_period": 2.0, "people": False}
    settings = usual | options
    world, seed = str(settings.pop("world", "room")), int(str(settings.pop("seed", 0)))
    messages = run(world, seed=seed, options=Options.model_validate(settings))
    records = ((m.topic.lstrip("/"), r) for m in messages for r in m.records)
    return _said(Config(), records)


def recorded(bag: Path, config: Config) -> list[list[tuple[str, float]]]:
    """Return what was said after each cycle of a recording."""
    with BagReader(bag) as reader:
        records = ((role, record) for role, _, record in reader.records(DEFAULT_TOPICS))
        return _said(config, records)


def _said(config: Config, records: Iterable[tuple[str, object]]) -> list[list[tuple[str, float]]]:
    robot = Robot(config, default_streams(), expects_odometry=True)
    processor, check, said = TccmProcessor(config), RigCheck(), []
    for role, record in records:
        for event in robot.add(role, record):
            for result in processor.add(event):
                check.add(result)
                said.append([(finding.name, finding.size) for finding in check.findings()])
    for result in processor.finish():
        check.add(result)
        said.append([(finding.name, finding.size) for finding in check.findings()])
    return said


def line(name: str, wanted: str | None, said: list[list[tuple[str, float]]]) -> str:
    """Return one line of the table."""
    firsts = [cycle[0][0] if cycle else None for cycle in said]
    first = firsts.index(wanted) if wanted in firsts else None
    others = Counter(n for cycle in said for n, _ in cycle if n != wanted)
    sizes = [size for cycle in said for n, size in cycle if n == wanted]
    spoken = ", ".join(f"{other} in {count}" for other, count in sorted(others.items())) or "-"
    if wanted is None:
        verdict = "silent" if not others else "**false alarm**"
        return f"| {name} | {len(said)} | - | {verdict} | - | {spoken} |"
    if first is None:
        there = sum(wanted in [n for n, _ in cycle] for cycle in said)
        verdict = f"not first, named in {there}" if there else "**not seen**"
        return f"| {name} | {len(said)} | - | {verdict} | {_size(wanted, sizes)} | {spoken} |"
    right = sum(one == wanted for one in firsts[first:])
    count = f"{right} of {len(firsts) - first}"
    return f"| {name} | {len(said)} | {first + 1} | {count} | {_size(wanted, sizes)} | {spoken} |"


def _size(name: str, sizes: list[float]) -> str:
    if not sizes:
        return "-"
    middle = float(np.median(sizes))
    metric = name in {"tilt scale", "doubled surface"}
    return f"{middle * 1e3:.0f} mm" if metric else f"{middle / DEG:+.2f} deg"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", nargs="+", type=Path)
    parser.add_argument("--trial", action="append", choices=TRIALS)
    arguments = parser.parse_args()
    print("| trial | cycles | named first after | in cycles since | size | also said, in cycles |\n"
          "|---|---|---|---|---|---|")  # fmt: skip
    for bag in arguments.bags or ():
        print(line(f"{bag.name} as it is", None, recorded(bag, Config())), flush=True)
        found = calibrate(bag)
        right = Config().model_copy(update={"rig": found.rig})
        print(line(f"{bag.name} calibrated", None, recorded(bag, right)), flush=True)
    if not arguments.bags:
        for name in arguments.trial or TRIALS:
            options, wanted = TRIALS[name]
            print(line(name, wanted, simulated(options)), flush=True)


if __name__ == "__main__":
    main()
