"""The bundled bags are complete, small, described in a README, and have true values."""

import hashlib
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

BAGS = Path(__file__).resolve().parents[2] / "bags"
NAMES = ("flat", "rgbd_kitchen", "office_signs", "upside_down", "walkthrough")
MEGABYTE = 1_000_000


def table(text: str, header: str) -> list[list[str]]:
    """Return the rows of the table of a README with this header."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(f"| {header} |")) + 2
    end = next((i for i in range(start, len(lines)) if not lines[i].startswith("|")), len(lines))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[start:end]]


@pytest.mark.parametrize("name", NAMES)
def test_checksums_are_those_of_the_readme(name):
    sums = dict(table((BAGS / name / "README.md").read_text(), "file"))
    files = {p.name for p in (BAGS / name).iterdir()} - {"README.md"}
    assert set(sums) == files
    for file, expected in sums.items():
        assert hashlib.sha256((BAGS / name / file).read_bytes()).hexdigest() == expected, file


@pytest.mark.parametrize("name", NAMES)
def test_messages_are_those_of_the_readme_and_their_checksums_hold(name):
    with (BAGS / name / f"{name}.mcap").open("rb") as stream:
        counts: dict[str, int] = {}
        for _, channel, _ in make_reader(stream, validate_crcs=True).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    rows = table((BAGS / name / "README.md").read_text(), "topic")
    assert {topic: int(count) for topic, _, count in rows} == counts


@pytest.mark.parametrize("name", NAMES)
def test_truth_has_surfaces_and_a_trajectory(name):
    truth = json.loads((BAGS / name / "truth.json").read_text())
    assert truth["frame_id"] == "map"
    for row in truth["surfaces"]:
        assert row["area"] >= 0.1
        assert np.array(row["boundary"])[:, 2] == pytest.approx(row["height"])
    poses = np.loadtxt(BAGS / name / "truth.tum")
    assert np.all(np.diff(poses[:, 0]) > 0)
    assert poses[0, 1:4] == pytest.approx([0, 0, 0], abs=1e-6)
    assert np.linalg.norm(poses[:, 4:], axis=1) == pytest.approx(1.0)


def test_the_bundled_bags_are_small():
    sizes = [p.stat().st_size for p in BAGS.rglob("*") if p.is_file()]
    assert sum(sizes) < 24 * MEGABYTE


def test_the_flat_has_the_required_duration_and_furniture():
    info = yaml.safe_load((BAGS / "flat" / "metadata.yaml").read_text())
    duration = info["rosbag2_bagfile_information"]["duration"]["nanoseconds"] * 1e-9
    assert 60.0 < duration < 120.0
    assert len(json.loads((BAGS / "flat" / "truth.json").read_text())["surfaces"]) >= 12


def test_the_script_that_makes_the_bags_lists_every_bag():
    sys.path.insert(0, str(BAGS))
    try:
        import make_bags
    finally:
        sys.path.remove(str(BAGS))
    assert tuple(bag.name for bag in make_bags.BAGS) == NAMES
    for bag in make_bags.BAGS:
        text = (BAGS / bag.name / "README.md").read_text()
        command = re.search(r"`tccm simulate (\S+) (\S+) --seed (\d+)", text)
        assert command is not None
        assert command.groups() == (bag.world, bag.name, str(bag.seed))
