import json

import numpy as np
import pytest
from map_server import as_map_server_reads
from result_folder import summary
from shapely import Polygon, box
from shapely.affinity import rotate, translate
from slam_run import drive, new_slam

from tccm_ros.atomic import output_folder
from tccm_ros.config import Config
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.errors import OutputError
from tccm_ros.records import Landmark, Wall
from tccm_ros.results.exports import write_results
from tccm_ros.results.floor_plan import close_corners
from tccm_ros.results.folder_reader import read_json
from tccm_ros.results.grid_files import grid_files
from tccm_ros.results.models import GraphFile
from tccm_ros.results.numbers import Stamp, json_text, rounded, write_json
from tccm_ros.results.trajectory import Trajectory
from tccm_ros.scene.planning_shapes import surface_box, surface_mesh
from tccm_ros.slam.occupancy import occupancy_grid

FILES = {
    "surfaces.json",
    "labels.json",
    "objects.json",
    "walls.json",
    "graph.json",
    "signs.json",
    "planes.json",
    "racks.json",
    "surfaces.geojson",
    "surfaces.scene",
    "summary.json",
    "surfaces.ply",
    "trajectory.tum",
    "cuboids.npz",
}


@pytest.fixture(scope="module")
def solution():
    return drive(new_slam()).solve()


@pytest.fixture
def folder(solution, tmp_path):
    return write(tmp_path, solution)


def write(folder, solution):
    no_cuboids = IntegrationMap(Config()).cuboids()
    write_results(folder, solution, [], no_cuboids, Config())
    write_json(folder / "summary.json", summary(cycles=0))
    return folder


def test_all_files_are_written_with_the_same_bytes_each_time(solution, folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("again")
    write(other, drive(new_slam()).solve())
    assert {p.name for p in folder.iterdir()} == FILES
    for name in FILES:
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


def test_surfaces_json_has_the_documented_keys(folder, solution):
    table = json.loads((folder / "surfaces.json").read_text())
    assert table["format"] == "tccm_ros/surfaces"
    assert table["version"] == 1
    assert table["frame_id"] == "map"
    assert table["floor_z"] == pytest.approx(0.0, abs=2e-3)
    keys = "id label height normal offset area centroid boundary holes points height_std"
    keys += " first_seen last_seen views plane_sigma plane_correlation"
    for entry in table["surfaces"]:
        assert set(keys.split()) <= set(entry)
        assert set(entry["views"][0]) == {"stamp", "keyframe", "points"}
        ring = Polygon([p[:2] for p in entry["boundary"]])
        assert entry["boundary"][0] != entry["boundary"][-1]
        assert ring.exterior.is_ccw
        assert entry["normal"][2] > 0.9
        on_plane = np.array(entry["boundary"]) @ entry["normal"] - entry["offset"]
        assert np.abs(on_plane).max() < 1e-5
        assert entry["height"] == entry["centroid"][2]
        # A laser's view of a room: millimetres, and its tops are level to a degree.
        assert 0.0005 < entry["plane_sigma"][0] < 0.02
        assert max(entry["plane_sigma"][1:]) < 0.03
    assert [s["label"] for s in table["surfaces"]].count("floor") >= 1


def test_the_ply_holds_every_point(folder, solution):
    data = (folder / "surfaces.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    rows = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "u1", 3), ("id", "<u4")])
    assert f"element vertex {len(rows)}" in header.decode()
    np.testing.assert_allclose(rows["xyz"], solution.mapped.points, atol=1e-6)
    np.testing.assert_array_equal(rows["id"], solution.mapped.surface_id)


def test_the_ply_is_read_as_its_header_declares_it(folder, solution):
    data = (folder / "surfaces.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    lines = [line.split() for line in header.decode("ascii").splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    kinds = {"float": "<f4", "uchar": "u1", "uint": "<u4"}
    dtype = [(name, kinds[kind]) for word, kind, name in lines[3:] if word == "property"]
    assert len(dtype) == len(lines) - 3
    (_, element, count) = lines[2]
    assert element == "vertex"
    rows = np.frombuffer(body, dtype)
    assert len(rows) == int(count) == len(solution.mapped.points)
    np.testing.assert_array_equal(rows["surface_id"], solution.mapped.surface_id)
    for surface in solution.surfaces:
        mine = rows[rows["surface_id"] == surface.id]
        assert len({tuple(row) for row in mine[["red", "green", "blue"]].tolist()}) == 1
        assert np.median(mine["z"]) == pytest.approx(surface.height, abs=0.01)


def test_the_trajectory_has_a_line_for_each_tilt_scan(folder):
    lines = (folder / "trajectory.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [f"{k}.000000000" for k in range(1, 5)]
    assert all(len(line.split()) == 8 for line in lines)


def test_cuboids_npz_is_read_without_pickle(folder):
    with np.load(folder / "cuboids.npz", allow_pickle=False) as arrays:
        assert {"ix", "iy", "top", "bottom", "count", "cls", "mean", "cov"} <= set(arrays.files)
        assert arrays["cycle_offsets"].tolist() == [0]


@pytest.mark.parametrize(
    ("value", "expected"),
    [(-1e-9, "0.0"), (1.23456789, "1.234568"), (float("inf"), "null"), (float("nan"), "null")],
)
def test_numbers_are_rounded_to_a_micrometre(value, expected):
    assert json_text(value).strip() == expected


def test_stamps_are_written_with_all_nanoseconds():
    assert str(Stamp(1_700_000_000_123_456_789)) == "1700000000.123456789"
    assert str(Stamp(-1)) == "-0.000000001"
    assert rounded(-0.0) == 0.0
    assert Stamp(1_700_000_000_123_456_789) == pytest.approx(1_700_000_000.123456789)
    assert Trajectory(np.array([5]), np.eye(4)[None]).tum().startswith("0.000000005 0.000000")


def test_json_of_an_unknown_type_is_an_error():
    with pytest.raises(TypeError):
        json_text(object())


def test_an_error_while_writing_leaves_no_file(tmp_path):
    def fail():
        with output_folder(tmp_path / "out") as made:
            (made / "half.json").write_text("{")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_other_files_of_the_result_folder_are_kept(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "map.png").write_text("old")
    with output_folder(tmp_path) as made:
        (made / "map.png").write_text("new")
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "map.png").read_text() == "new"


def test_a_file_with_the_name_of_the_folder_is_an_error(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(OutputError, match="give a folder"), output_folder(tmp_path / "out"):
        pass


def test_a_box_covers_its_surface(solution):
    for surface in solution.surfaces:
        box = surface_box(surface)
        local = (surface.boundary - box.T_map_box[:3, 3]) @ box.T_map_box[:3, :3]
        assert np.all(np.abs(local) <= 0.5 * box.size + 1e-6)
        np.testing.assert_allclose(local[:, 2], 0.5 * box.size[2], atol=1e-6)


def test_a_mesh_is_closed_and_has_the_volume_of_the_slab(solution):
    for surface in solution.surfaces:
        mesh = surface_mesh(surface, thickness=0.02)
        edges = mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        directed = set(map(tuple, edges.tolist()))
        assert directed == {(b, a) for a, b in directed}
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
        assert volume == pytest.approx(0.02 * surface.area / surface.normal[2], rel=1e-3)


def wall(k, phi, rho, ends, corners=()):
    return Wall(k, phi, rho, np.array(ends, float), 9, np.eye(2), tuple(corners))


def test_walls_with_a_common_corner_end_at_their_crossing():
    walls = [
        wall(0, 0.0, 2.0, [[2, -1], [2, 1.9]], [1]),
        wall(1, np.pi / 2, 2.1, [[1.9, 2.1], [-1, 2.1]], [0]),
    ]
    first, second = close_corners(walls)
    np.testing.assert_allclose(first, [[2, -1], [2, 2.1]], atol=1e-9)
    np.testing.assert_allclose(second, [[2, 2.1], [-1, 2.1]], atol=1e-9)


def test_ends_near_their_crossing_are_moved_to_it_without_a_seen_corner():
    walls = [
        wall(0, 0.0, 2.0, [[2, -1], [2, 1.9]]),
        wall(1, np.pi / 2, 2.0, [[1.8, 2.0], [-1, 2.0]]),
    ]
    first, second = close_corners(walls)
    np.testing.assert_allclose(first, [[2, -1], [2, 2]], atol=1e-9)
    np.testing.assert_allclose(second, [[2, 2], [-1, 2]], atol=1e-9)


def test_an_end_is_moved_onto_the_middle_of_a_wall_that_is_not_cut():
    walls = [
        wall(0, 0.0, 2.0, [[2, -3], [2, 3]]),
        wall(1, np.pi / 2, 2.9, [[1.8, 2.9], [-1, 2.9]]),
        wall(2, np.pi / 2, 0.0, [[2.1, 0.0], [5, 0.0]]),
    ]
    first, second, third = close_corners(walls)
    np.testing.assert_allclose(first, [[2, -3], [2, 3]], atol=1e-9)
    np.testing.assert_allclose(second, [[2, 2.9], [-1, 2.9]], atol=1e-9)
    np.testing.assert_allclose(third, [[2, 0], [5, 0]], atol=1e-9)


def test_a_gap_as_wide_as_a_door_in_a_corner_is_not_closed():
    walls = [
        wall(0, 0.0, 2.0, [[2, -1], [2, 1.3]]),
        wall(1, np.pi / 2, 2.0, [[2.0, 2.0], [-1, 2.0]]),
    ]
    np.testing.assert_allclose(close_corners(walls)[0], [[2, -1], [2, 1.3]], atol=1e-9)


def test_the_occupancy_grid_is_free_up_to_the_wall_and_occupied_there(tmp_path):
    y = np.linspace(-0.9, 0.9, 200)
    state = {
        "keyframe_pose": np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]),
        "scan_origin": np.zeros((2, 2)),
        "scan_count": np.array([200, 200]),
        "scan_points": np.concatenate([np.c_[np.full(200, 2.02), y], np.c_[np.full(200, 1.52), y]]),
    }
    grid = occupancy_grid(state, 0.05)

    def cell(x, y):
        column, row = np.floor((np.array([x, y]) - grid.origin) / grid.resolution).astype(int)
        return grid.cells[row, column]

    assert (cell(2.02, 0.0), cell(1.0, 0.0), cell(2.3, 0.0), cell(0.0, 0.7)) == (100, 0, -1, -1)
    for name, content in grid_files("map", grid).items():
        (tmp_path / name).write_bytes(content)
    cells, resolution, origin = as_map_server_reads(tmp_path / "map.yaml")
    assert cells.tobytes() == grid.cells.tobytes()
    assert (resolution, origin) == (0.05, pytest.approx([*grid.origin, 0.0]))


def test_without_a_level_laser_there_is_no_occupancy_grid():
    assert occupancy_grid({}) is None


def test_landmarks_are_written_and_read(tmp_path):
    mark = Landmark("sign", 4, np.array([1.0, 2.0, 1.5]), np.eye(3) * 1e-4, 3)
    (tmp_path / "graph.json").write_text(json_text(GraphFile.of([], [], [mark])))
    (read,) = read_json(tmp_path / "graph.json", GraphFile).landmarks
    assert (read.kind, read.id, read.observations) == ("sign", 4, 3)
    np.testing.assert_array_equal(read.position, mark.position)
    np.testing.assert_array_equal(read.covariance, mark.covariance)


def test_placements_are_ranked_and_clear_of_edges_and_of_each_other(solution, folder):
    """Of each footprint by hand: inside what was seen, off its edge and off all earlier ones."""
    written = json.loads((folder / "objects.json").read_text())["placements"]
    assert written["size"] == [*solution.place_size, 0.2]
    assert written["clearance"] == 0.02
    ranked = written["ranked"]
    assert 0 < len(ranked) <= 20
    assert [p["clearance"] for p in ranked] == sorted(p["clearance"] for p in ranked)[::-1]
    seen = {s.id: Polygon(s.boundary_seen[:, :2]) for s in solution.surfaces if s.label != "floor"}
    placed = []
    for entry in ranked:
        footprint = rotate(box(-0.075, -0.075, 0.075, 0.075), entry["yaw"], (0, 0), True)
        footprint = translate(footprint, *entry["position"][:2])
        surface = seen[entry["surface"]]
        assert surface.contains(footprint)
        free = [surface.exterior, *(f for s, f in placed if s == entry["surface"])]
        distance = min(footprint.distance(other) for other in free)
        assert distance >= entry["clearance"] - 1e-5
        assert distance >= written["clearance"] - 1e-5
        placed.append((entry["surface"], footprint))
