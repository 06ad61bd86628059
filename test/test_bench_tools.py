"""The tools beside the benchmarks: tables become numbers, and two runs are compared."""

import ast
import itertools
import json
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
BENCH = ROOT / "bench"
sys.path.append(str(BENCH))

import bench_catalogue  # noqa: E402
import bench_fleet  # noqa: E402
import bench_objects  # noqa: E402
import merge_drives  # noqa: E402
import mutation  # noqa: E402
from compare import differences  # noqa: E402
from random_flats import random_flat  # noqa: E402
from run import IN_SHORT  # noqa: E402
from tables import Value, values_of  # noqa: E402

from tccm_ros.fleet.catalogue import Catalogue  # noqa: E402

OUTPUT = """
text | with a bar

### Times (medians)

| step | ours, ms | twin, ms | peer |
|---|---|---|---|
| points to map, 20 mm | 0.47 | 1,234.5 | not installed |
| **all** | **3** | 2 +- 1 | |

| 40 | 1.5 |
not a table

| scene | ms |
|---|---|
| 10 | 2e-3 |
| 20 | -4 |
"""


def test_numbers_of_tables_are_found_with_their_row_and_column():
    heading = "Times (medians)"
    assert values_of(OUTPUT) == [
        Value(heading, "points to map, 20 mm", "ours, ms", 0.47),
        Value(heading, "points to map, 20 mm", "twin, ms", 1234.5),
        Value(heading, "all", "ours, ms", 3.0),
        Value(heading, "all", "twin, ms", 2.0),
        Value(heading, "scene 10", "ms", 0.002),
        Value(heading, "scene 20", "ms", -4.0),
    ]


def test_rows_of_one_name_are_numbered():
    text = "| a | b |\n|---|---|\n| x | 1 |\n| x | 2 |\n"
    assert [(v.row, v.value) for v in values_of(text)] == [("x", 1.0), ("x (2)", 2.0)]


def test_differences_of_machines_are_named():
    before = {"cores": 2, "packages": {"numpy": "2.1", "gtsam": "4.3"}}
    after = {"cores": 2, "packages": {"numpy": "2.2", "gtsam": "4.3"}}
    assert differences(before, before) == []
    assert differences(before, after) == ["packages numpy: 2.1 before, 2.2 after"]


@pytest.fixture
def files(tmp_path):
    """Two files of results in which one number doubles."""
    for name, twin in (("before", 1.0), ("after", 2.0)):
        rows = [("ours", 0.5), ("twin", twin)]
        values = [{"table": "T", "row": r, "column": "ms", "value": v} for r, v in rows]
        content = {"machine": {}, "benchmarks": {"bench_x": {"seconds": 1.0, "values": values}}}
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    return tmp_path


def compare(*args):
    command = [sys.executable, str(BENCH / "compare.py"), *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_two_runs_are_compared_row_by_row(files):
    done = compare(files / "before.json", files / "after.json")
    assert done.returncode == 0
    assert "| bench_x: T | ours | ms | 0.5 | 0.5 | 1.00 |" in done.stdout
    assert "| bench_x: T | twin | ms | 1 | 2 | 2.00 |" in done.stdout
    above = compare(files / "before.json", files / "after.json", "--above", "1.1").stdout
    assert "ours" not in above
    assert "twin" in above


def test_a_file_that_is_no_result_is_an_error(files):
    (files / "other.json").write_text("[]")
    done = compare(files / "before.json", files / "other.json")
    assert done.returncode == 1
    assert "not the results" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_catalogue_that_is_timed_answers(tmp_path):
    catalogue = Catalogue(tmp_path / "catalogue")
    bench_catalogue.write_surfaces(catalogue, maps=500, surfaces=10, own_files=3)
    (count,) = catalogue.ask("SELECT count(*) FROM surfaces").rows
    assert count == (5000,)
    for query in bench_catalogue.QUERIES.values():
        assert catalogue.ask(query).rows


def test_the_flats_of_the_fleet_have_the_stops_that_are_timed():
    for flat in range(bench_fleet.FLATS):
        whole = random_flat(flat)
        assert len(whole.drive.stops) > bench_fleet.MIN_STOPS
        part = random_flat(flat, stops=slice(1, 1 + bench_fleet.STOPS))
        assert len(part.drive.stops) == bench_fleet.STOPS
        assert part.duration < whole.duration / 2


def test_results_that_differ_have_another_digest(tmp_path):
    (tmp_path / "surfaces.json").write_text("{}")
    before = bench_fleet.digest(tmp_path)
    (tmp_path / "timing.json").write_text("{}")
    assert bench_fleet.digest(tmp_path) == before
    (tmp_path / "surfaces.json").write_text("[]")
    assert bench_fleet.digest(tmp_path) != before


def test_four_robots_begin_at_other_places_of_one_building():
    for building in ("flat", "ring"):
        starts = [merge_drives.BUILDINGS[building](robot).drive.states[0, :2] for robot in range(4)]
        distances = [float(abs(a - b).max()) for a, b in itertools.combinations(starts, 2)]
        assert min(distances) > 0.5


def test_short_runs_name_existing_benchmarks_and_options():
    for name, arguments in IN_SHORT.items():
        text = (BENCH / f"{name}.py").read_text()
        for word in (a for a in arguments if not a.isdigit()):
            assert f'"{word}"' in text or Path(word).exists(), (name, word)


def test_requirements_name_all_that_benchmarks_import():
    brought = {"distributed": "dask", "psutil": "dask"}
    names = {"PIL": "pillow", "mpl_toolkits": "matplotlib", "yaml": "pyyaml", **brought}
    files = [(ROOT / f"requirements-{kind}.txt").read_text() for kind in ("test", "bench")]
    lines = [line for text in files for line in text.splitlines() if line and line[0] not in "#-"]
    lines += [r.partition(";")[0] for r in metadata.requires("tccm_ros")]
    listed = {re.split(r"[\[<>=,]", line)[0].replace("-", "_") for line in lines}
    own = {"tccm_ros", "tccm_sim", "tccm_interfaces"} | {
        path.stem
        for folder in (BENCH, ROOT / "tools", ROOT / "test/helpers")
        for path in folder.glob("*.py")
    }
    for path in BENCH.glob("*.py"):
        for name in imported(path):
            if name in sys.stdlib_module_names or name in own:
                continue
            if name.endswith(("_msgs", "_srvs")) or name == "rclpy":
                name = "ros_jazzy_rclpy"
            assert names.get(name, name) in listed, f"{path.name} imports {name}"


def imported(path):
    """The packages that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            yield node.module.split(".")[0]
        elif isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)


def test_objects_are_whole_merged_split_or_missed():
    """Five labelled objects: one whole, two in one box, one in two halves, one not found."""
    count = bench_objects.MIN_POINTS
    label = np.repeat([2, 3, 4, 5, 6], 2 * count)
    found = np.repeat([0, 0, 1, 1, 1, 1, 2, 3, -1, -1], count)
    found[:10] = 9
    tally = bench_objects.Tally()
    tally.add(label, found)
    assert (tally.labelled, tally.whole, tally.merged, tally.split, tally.missed) == (5, 1, 2, 1, 1)
    assert tally.extra == 2  # of the ten points, and the other half


def test_the_labelled_top_is_level_wherever_the_camera_looks():
    rng = np.random.default_rng(3)
    top = rng.uniform((-0.5, -0.4, 0.0), (0.5, 0.4, 0.0), (400, 3))
    mug = rng.uniform((0.0, 0.0, 0.02), (0.08, 0.08, 0.12), (100, 3))
    label = np.repeat([1, 20], [400, 100])
    camera = np.array([0.2, -1.0, 0.9])
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    points, viewpoint = bench_objects.levelled((np.vstack([top, mug]) - camera) @ R.T, label)
    assert np.abs(points[:400, 2] - bench_objects.TOP_HEIGHT).max() < 1e-9
    assert np.abs(points[400:, 2] - bench_objects.TOP_HEIGHT - mug[:, 2]).max() < 1e-9
    assert abs(viewpoint[2] - bench_objects.TOP_HEIGHT - camera[2]) < 1e-9


def test_mutation_finds_the_modules_of_the_core_and_their_tests():
    assert not [p for p in mutation.CORE if not list((ROOT / "tccm_ros").glob(p))]
    found = mutation.modules()
    assert {"surfaces/merging/contact.py", "slam/walls/line_fit.py"} <= set(found)
    nearest = mutation.stages("surfaces/merging/contact.py")[0]
    assert any(name.endswith("merging/test_contact.py") for name in nearest)
