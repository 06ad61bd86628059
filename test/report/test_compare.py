"""Comparisons of two maps find the surfaces and walls that came, went and moved."""

import json
import shutil

import numpy as np
import pytest
from draw_figures import forgetting_png, write_figures
from PIL import Image

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import Odometry, SurfaceCloud
from tccm_ros.report.compare import compare
from tccm_ros.report.compare_page import write_comparison
from tccm_ros.report.viewing import find_report, report_map, view
from tccm_ros.results.folder_reader import load_results
from tccm_ros.results.map_file import save_map


def edit(path, change):
    tree = json.loads(path.read_text())
    change(tree)
    path.write_text(json.dumps(tree))


def shift(surface, dx, dy, dz=0.0):
    rings = [surface["boundary"], *surface["holes"], [surface["centroid"]]]
    for point in (p for ring in rings for p in ring):
        point[:] = [point[0] + dx, point[1] + dy, point[2] + dz]
    surface["height"] += dz


def kinds(comparison):
    return {(c.after or c.before).id: c.kind for c in comparison.surfaces}


def test_a_map_is_the_same_as_itself(flat):
    comparison = compare(flat, flat)
    assert set(kinds(comparison).values()) == {"same"}
    assert len(comparison.surfaces) == 10
    assert comparison.counts(comparison.walls) == "6 same, 0 moved, 0 came, 0 went"
    assert comparison.path.rms == comparison.path.largest == 0.0
    assert comparison.path.poses == 61


def test_a_surface_in_one_map_alone_came_or_went(flat, flat_copy):
    def change(tree):
        tree["surfaces"] = [s for s in tree["surfaces"] if s["id"] != 9]

    edit(flat_copy / "surfaces.json", change)
    there, back = kinds(compare(flat, flat_copy)), kinds(compare(flat_copy, flat))
    assert there[9] == "went"
    assert back[9] == "came"
    assert all(kind == "same" for index, kind in there.items() if index != 9)


@pytest.mark.parametrize("move", [(-0.6, -0.3), (-2.0, 0.4), (0.0, 0.08)])
def test_a_table_at_another_position_has_moved(flat, flat_copy, move):
    edit(flat_copy / "surfaces.json", lambda tree: shift(tree["surfaces"][8], *move))
    comparison = compare(flat, flat_copy)
    assert kinds(comparison)[8] == "moved"
    row = next(row for row in comparison.surface_rows() if row[0] == "moved")
    assert float(row[-1]) == pytest.approx(np.hypot(*move), abs=1e-3)


def test_a_table_seen_in_part_has_not_moved(flat, flat_copy):
    def change(tree):
        seat = tree["surfaces"][7]
        seat["boundary"] = [[max(x, 5.4), y, z] for x, y, z in seat["boundary"]]
        seat["centroid"][0] = 6.0

    edit(flat_copy / "surfaces.json", change)
    assert kinds(compare(flat, flat_copy))[7] == "same"


def test_a_shelf_at_another_height_is_another_surface(flat, flat_copy):
    edit(flat_copy / "surfaces.json", lambda tree: shift(tree["surfaces"][5], 0, 0, 0.2))
    changes = [c.kind for c in compare(flat, flat_copy).surfaces]
    assert sorted(changes) == ["came"] + ["same"] * 9 + ["went"]


def test_a_stove_little_above_a_counter_is_not_taken_for_it(flat, flat_copy):
    """It is inside the counter's outline, which the counter of the other map fits less well."""

    def stove(tree):
        table = tree["surfaces"][8]
        center = np.array(table["centroid"])
        above = {**json.loads(json.dumps(table)), "id": 99, "merged_ids": []}
        ring = center + 0.4 * (np.array(table["boundary"]) - center)
        above["boundary"] = ring.tolist()
        above["area"] = 0.16 * table["area"]
        shift(above, 0, 0, 0.03)
        tree["surfaces"].append(above)
        return table

    before, after = flat_copy.parent / "before", flat_copy.parent / "after"
    shutil.copytree(flat_copy, before)
    edit(before / "surfaces.json", stove)
    edit(flat_copy / "surfaces.json", lambda tree: shift(stove(tree), 0.02, 0.01))
    flat_copy.rename(after)
    pairs = {
        c.before.id: c.after.id for c in compare(before, after).surfaces if c.before and c.after
    }
    assert pairs[99] == 99
    assert len(pairs) == 11
    assert all(one == other for one, other in pairs.items())


def test_heights_are_compared_over_the_floor_of_each_map(flat, flat_copy):
    def change(tree):
        tree["floor_z"] += 0.3
        for surface in tree["surfaces"]:
            shift(surface, 0, 0, 0.3)

    edit(flat_copy / "surfaces.json", change)
    assert set(kinds(compare(flat, flat_copy)).values()) == {"same"}


def test_walls_are_matched_by_line_and_extent(flat, flat_copy):
    def change(tree):
        del tree["walls"][5]
        # Through the origin, the normal may point either way.
        tree["walls"][0]["phi"] = np.pi if tree["walls"][0]["phi"] == 0 else 0.0
        tree["walls"][0]["rho"] = 0.0

    edit(flat_copy / "walls.json", change)
    walls = compare(flat, flat_copy).walls
    assert [(w.kind, w.before.id) for w in walls if w.kind != "same"] == [("went", 5)]


def test_paths_are_compared_at_equal_stamps(flat, flat_copy):
    file = flat_copy / "trajectory.tum"
    lines = [line.split() for line in file.read_text().splitlines()]
    for line in lines:
        line[1] = f"{float(line[1]) + 0.05:.6f}"
    file.write_text("".join(" ".join(line) + "\n" for line in lines[:50]))
    path = compare(flat, flat_copy).path
    assert path.poses == 50
    assert path.rms == pytest.approx(0.05, abs=1e-6)
    for line in lines:
        line[0] = f"{float(line[0]) + 1000:.3f}"
    file.write_text("".join(" ".join(line) + "\n" for line in lines))
    assert compare(flat, flat_copy).path.rms is None
    assert "different times" in compare(flat, flat_copy).text()


def test_the_text_lists_every_change(flat, flat_copy):
    edit(flat_copy / "surfaces.json", lambda tree: shift(tree["surfaces"][8], 0.5, 0))
    text = compare(flat, flat_copy).text()
    assert "moved  table" in text
    assert "0.500" in text
    assert all(len(line) < 120 for line in text.splitlines())


def test_picture_and_page_are_repeatable_and_escaped(flat, flat_copy, tmp_path):
    evil = "<script>alert(1)</script>"
    edit(flat_copy / "surfaces.json", lambda tree: tree["surfaces"][8].update(label=evil))
    comparison = compare(flat, flat_copy)
    first = [p.read_bytes() for p in write_comparison(comparison, tmp_path / "a")]
    again = [p.read_bytes() for p in write_comparison(comparison, tmp_path / "b")]
    assert first == again
    assert b"<script>alert" not in first[1]
    assert Image.open(tmp_path / "a" / "compare.png").size[0] == 2400


def test_a_damaged_folder_and_a_path_that_cannot_be_written_are_errors(flat, tmp_path):
    with pytest.raises(MapError, match="no such folder"):
        compare(flat, tmp_path / "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_comparison(compare(flat, flat), tmp_path / "file" / "x")


# --- opening, and the pictures of the documentation -------------------------------------------


def test_view_writes_a_missing_report_and_opens_it(flat_copy):
    (flat_copy / "report.html").unlink(missing_ok=True)
    opened = []
    report = view(flat_copy, open_page=opened.append)
    assert report == flat_copy / "report.html"
    assert opened == [report.resolve().as_uri()]
    before = report.stat().st_mtime_ns
    assert find_report(flat_copy).stat().st_mtime_ns == before
    assert find_report(report) == report


def test_view_of_a_wrong_target_is_an_error_that_says_why(flat_copy, tmp_path):
    with pytest.raises(MapError, match=r"no surfaces\.json here"):
        view(tmp_path, open_page=print)
    with pytest.raises(OutputError, match="no browser opens here"):
        view(flat_copy, open_page=lambda _: False)


def test_the_pictures_of_the_documentation_are_repeatable(flat, flat_copy, tmp_path):
    written = write_figures(flat, tmp_path / "figures")
    assert [p.name for p in written] == ["map.png", "map3d.png", "forgetting.png"]
    again = write_figures(flat, tmp_path / "again")
    assert [p.read_bytes() for p in written] == [p.read_bytes() for p in again]
    (flat_copy / "cycles.npz").unlink()
    assert len(write_figures(flat_copy, tmp_path / "figures")) == 2
    with pytest.raises(MapError, match=r"no cycles\.npz"):
        forgetting_png(load_results(flat_copy))


def table_cloud(stamp_ns):
    x, y = np.meshgrid(np.arange(1.0, 2.0, 0.02), np.arange(-0.5, 0.5, 0.02))
    floor = np.column_stack([x.ravel() - 0.8, y.ravel(), np.zeros(x.size)])
    table = np.column_stack([x.ravel() + 0.5, y.ravel(), np.full(x.size, 0.7)])
    points = np.concatenate([floor, table]).astype(np.float32)
    return SurfaceCloud(
        stamp_ns, "base_link", points, np.repeat(np.arange(2), x.size).astype(np.uint32)
    )


def test_a_saved_map_has_a_report(tmp_path):
    slam = SurfaceSlam(Config())
    for i in range(5):
        slam.add(Odometry(i * 10**9, "odom", "base_link", np.eye(4)))
    slam.add(table_cloud(2 * 10**9))
    solution = slam.solve()
    save_map(tmp_path / "map.mcap", slam.saved(solution), solution)
    report = report_map(tmp_path / "map.mcap", tmp_path / "shown")
    assert view(report, open_page=lambda _: True) == report
    shown = load_results(tmp_path / "shown")
    assert [round(s.height - shown.ground, 3) for s in shown.above_floor] == [0.7]
    assert {p.name for p in report.parent.iterdir()} >= {"map.png", "map3d.png", "surfaces.json"}


def test_a_report_of_a_file_that_is_no_map_is_an_error(tmp_path):
    (tmp_path / "map.mcap").write_bytes(b"not a map")
    with pytest.raises(MapError, match=r"map\.mcap"):
        report_map(tmp_path / "map.mcap", tmp_path / "shown")
