"""result.mcap: topics, times, frames and contents, read back by two other libraries."""

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from surface_maps import poses_at

from tccm_ros.config import Config
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.errors import OutputError
from tccm_ros.geometry import pose_from_rpy, quaternion, spatial
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import (
    Keyframe,
    ObjectBoxes,
    PlaneRecord,
    Surface,
    SurfaceCloud,
    SurfaceSighting,
    TabletopObject,
    ViewIntervals,
    Wall,
)
from tccm_ros.results.result_bag import CycleMessageStore, write_result_bag
from tccm_ros.scene.changes import Change, ChangeKind
from tccm_ros.slam.occupancy import OccupancyGrid
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.surfaces.surface_map import MappedSurfaces

S = 1_000_000_000
UP = np.array([0.0, 0.0, 1.0])
RING = np.array([[1.0, 0, 0.7], [1.5, 0, 0.7], [1.5, 0.4, 0.7], [1.0, 0.4, 0.7]])
CUP = SceneObject(5, 1, np.array([1.2, 0.2, 0.75]), np.array([0.08, 0.08, 0.1]), 0.0)
GRID = OccupancyGrid(np.array([[0, 100, -1]], np.int8), 0.05, np.array([-1.0, 2.0]))
ALONG = np.diag([0.04, 0.01, 0.02])
CONFIG = Config.model_validate({"map": {"window_cycles": 2, "gap": "fixed"}})


def cycle_result(index):
    """Return a tilt cycle whose part map is a patch of a table at y = index."""
    x, y = np.meshgrid(np.arange(1.0, 1.5, 0.02), np.arange(0.0, 0.4, 0.02))
    points = np.column_stack([x.ravel(), y.ravel() + index, np.full(x.size, 0.7)])
    builder = PartMapBuilder(CONFIG)
    builder.add_points(points)
    start, end = (10 + 2 * index) * S, (12 + 2 * index) * S
    middle = (start + end) // 2
    plane = PlaneRecord(
        index, "horizontal", UP, 0.7, np.eye(3) * 1e-6, 500, 0.2, 0.15, RING, (), 0.002,
        RING.mean(axis=0),
    )  # fmt: skip
    return CycleResult(
        cycle=index, stamp_ns=middle, start_ns=start, end_ns=end, frame_id="odom",
        base_frame_id="base_link", T_odom_base=pose_from_rpy([0.3 * index, 0, 0, 0, 0, 0.1]),
        planes=[plane], objects=[TabletopObject(0, index, RING.mean(axis=0), np.ones(3), 0.2)],
        surfaces=SurfaceCloud(middle, "base_link", np.float32(RING), np.zeros(4, "u4")),
        view=ViewIntervals(middle, "base_link", np.zeros((0, 4), np.float32)),
        boxes=ObjectBoxes(
            middle, "base_link", (RING[:3, :2],), np.array([[0.7, 0.8]]), np.ones(1, "u4")
        ),
        part=builder.close(index, start, end), scans=3, base_speed=0.0, base_angular_speed=0.0,
        ended_by="turn",
    )  # fmt: skip


def surface(index, seen_ns):
    sight = (SurfaceSighting(seen_ns, 0, 4),)
    return Surface(
        index, "table", 0.9, 0.7, UP, 0.7, 0.2, RING.mean(axis=0), RING, (), 4, 0.002, seen_ns,
        seen_ns, sight,
    )  # fmt: skip


def solution(cycles, level_scans=30):
    stamps = np.arange(level_scans) * S // 2 + 9 * S
    poses = np.column_stack([np.linspace(0, 1, level_scans), np.zeros(level_scans),
                             np.linspace(0, 0.2, level_scans)]).reshape(-1, 3)  # fmt: skip
    wall = Wall(0, 0.0, 2.0, np.array([[2.0, -1.0], [2.0, 1.0]]), 5, np.eye(2) * 1e-4)
    slam = Solution(
        [Keyframe(0, 9 * S, np.zeros(3)), Keyframe(1, 14 * S, poses[10])] if level_scans else [],
        [wall], [], stamps, poses, np.zeros((0, 4, 4)), np.zeros((0, 6, 6)), np.zeros(0, int),
        np.stack([np.eye(3) * 0.01, ALONG])[: 2 if level_scans else 0],
    )  # fmt: skip
    seen = [cycles[0].stamp_ns, cycles[2].stamp_ns] if cycles else []
    surfaces = tuple(surface(i, s) for i, s in enumerate(seen))
    ids = np.repeat(np.arange(len(seen)), 4).astype(np.uint32)
    points = np.tile(np.float32(RING), (len(seen), 1)).reshape(-1, 3)
    mapped = MappedSurfaces(surfaces, 0.0, points, ids, ((),) * len(seen))
    T_views = np.tile(np.eye(4), (len(seen), 1, 1))
    return SurfaceSolution(
        graph=slam, view_stamps_ns=np.array(seen, np.int64), T_map_views=T_views,
        view_poses=poses_at(T_views), mapped=mapped, trajectory_ns=stamps, trajectory=poses,
        objects=(CUP,) if cycles else (), stamp_ns=int(stamps[-1]) if len(stamps) else 0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def cycles():
    return [cycle_result(i) for i in range(3)]


@pytest.fixture(scope="module")
def bag(cycles, tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "result.mcap"
    return write(path, cycles, solution(cycles))


def cup_appeared(stamp_ns):
    kind, T = ChangeKind.OBJECT_APPEARED, np.eye(4)
    return Change(kind, stamp_ns, ids_after=(1,), object_id=CUP.id, T_after=T)


def write(path, cycles, solved, config=CONFIG):
    """Write a result bag as a replay does: the messages of each cycle from the map after it."""
    messages, map_ = CycleMessageStore(config), IntegrationMap(config)
    for cycle in cycles:
        map_.add(cycle.part)
        messages.add(cycle, map_.cuboids())
    # The second view tells that the cup came with the first one.
    events = [(cycles[1].stamp_ns, cup_appeared(cycles[0].stamp_ns))] if cycles else []
    write_result_bag(path, cycles, messages, solved, config, events, GRID)
    return path


@pytest.fixture(scope="module")
def messages(bag):
    return read(bag)


def read(bag):
    """Return [(log time, message)] by topic, as rosbags reads them."""
    found = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    return found


def stamp_of(header):
    return header.stamp.sec * S + header.stamp.nanosec


def matrix(pose_or_transform):
    t = getattr(pose_or_transform, "translation", None) or pose_or_transform.position
    q = getattr(pose_or_transform, "rotation", None) or pose_or_transform.orientation
    return np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w])


def shown(array):
    """Return (namespace, id) of the markers that a MarkerArray adds."""
    return {(m.ns, m.id) for m in array.markers if m.action == 0}


def test_the_bag_has_every_topic_of_the_nodes_except_diagnostics(messages):
    counts = {topic: len(found) for topic, found in messages.items()}
    assert counts == {
        "/tccm/planes": 3, "/tccm/objects": 3, "/tccm/cuboids": 1, "/tccm/map_cloud": 3,
        "/tccm/center_cores": 1, "/tccm/obstacles": 1,
        "/tccm/surfaces": 3, "/tccm/view": 3, "/tf": 3, "/surface_slam/map_to_odom": 3,
        "/pose": 30, "/surface_slam/path": 1, "/surface_slam/walls": 1,
        "/surface_slam/signs": 1,
        "/surface_slam/surfaces": 3, "/surface_slam/surface_cloud": 1, "/tccm/object_boxes": 3,
        "/surface_slam/surface_map": 1, "/surface_slam/objects": 1, "/surface_slam/tables": 1,
        "/surface_slam/events": 1, "/surface_slam/localisation": 1, "/map": 1,
        "/collision_object": 3,
    }  # fmt: skip


def test_tables_and_collision_objects_have_the_stamp_of_the_solution(messages):
    last = 23 * S + S // 2
    ((log, tables),) = messages["/surface_slam/tables"]
    assert (log, stamp_of(tables.header)) == (last, last)
    assert len(tables.tables) == 2
    logs, objects = zip(*messages["/collision_object"])
    assert {*logs, *(stamp_of(o.header) for o in objects)} == {last}
    assert [o.id for o in objects] == ["tccm_surface_0", "tccm_surface_1", "tccm_object_5"]
    assert [o.operation for o in objects] == [0, 0, 0]


def test_the_grid_and_the_localisation_are_those_of_the_solution(messages):
    ((log, grid),) = messages["/map"]
    assert (log, stamp_of(grid.header)) == (23 * S + S // 2,) * 2
    assert (grid.info.width, grid.info.height, grid.data.tolist()) == (3, 1, [0, 100, -1])
    assert matrix(grid.info.origin)[0].tolist() == [-1.0, 2.0, 0.0]
    ((log, place),) = messages["/surface_slam/localisation"]
    assert (log, place.state, place.header.frame_id) == (23 * S + S // 2, 1, "map")
    assert matrix(place.pose.pose)[0][0] == pytest.approx(1.0)


def test_event_has_the_end_stamp_of_its_view(messages, cycles):
    ((log, event),) = messages["/surface_slam/events"]
    assert (log, stamp_of(event.header)) == (cycles[1].end_ns, cycles[0].stamp_ns)
    assert (event.kind, event.object_id, list(event.surface_ids_after)) == (6, 5, [1])
    assert np.isnan(matrix(event.pose_before)[0]).all()


def test_every_message_is_read_by_the_schemas_in_the_file_alone(bag):
    """As Foxglove does: a schema has the definitions of all that its type contains."""
    with bag.open("rb") as stream:
        reader = make_reader(stream)
        schemas = {s.name: s.data.decode() for s, _, _ in reader.iter_messages()}
        types = {}
        for name, text in schemas.items():
            types[name] = get_typestore(Stores.EMPTY)
            types[name].register(get_types_from_msg(text, name))
        read = [
            types[schema.name].deserialize_cdr(message.data, schema.name)
            for schema, _, message in reader.iter_messages()
        ]
    assert len(schemas) > 8
    assert len(read) > 30


def test_log_times_are_those_of_the_causing_records_and_never_decrease(bag, messages, cycles):
    with bag.open("rb") as stream:
        read = list(make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False))
    times = [message.log_time for _, _, message in read]
    assert times == sorted(times)
    assert all(message.publish_time == message.log_time for _, _, message in read)
    assert [log for log, _ in messages["/tccm/planes"]] == [c.end_ns for c in cycles]
    headers = [stamp_of(m.markers[0].header) for _, m in messages["/tccm/planes"]]
    assert headers == [c.stamp_ns for c in cycles]
    assert all(log == stamp_of(m.header) for log, m in messages["/pose"])


def test_tf_connects_map_to_base(messages, cycles):
    for (_, message), cycle in zip(messages["/tf"], cycles, strict=True):
        odom, base = message.transforms
        assert (odom.header.frame_id, odom.child_frame_id) == ("map", "odom")
        assert (base.header.frame_id, base.child_frame_id) == ("odom", "base_link")
        assert stamp_of(odom.header) == cycle.stamp_ns
        chain = np.eye(4)
        for transform in (odom, base):
            t, q = matrix(transform.transform)
            chain = chain @ pose_of(t, q)
        x = np.interp(cycle.stamp_ns / S, [9, 23.5], [0, 1])
        yaw = np.interp(cycle.stamp_ns / S, [9, 23.5], [0, 0.2])
        assert np.allclose(chain, spatial([x, 0.0, yaw]), atol=1e-9)


def test_frames_of_surfaces_are_on_tf_where_asked_for_once_they_were_seen(cycles, tmp_path):
    asked = CONFIG.model_copy(update={"tf": CONFIG.tf.model_copy(update={"surfaces": True})})
    bag = write(tmp_path / "result.mcap", cycles, solution(cycles), asked)
    found = []
    for (_, message), cycle in zip(read(bag)["/tf"], cycles, strict=True):
        frames = [t for t in message.transforms if t.child_frame_id.startswith("surface_")]
        assert {(t.header.frame_id, stamp_of(t.header)) for t in frames} == {
            ("map", cycle.stamp_ns)
        }
        found.append([t.child_frame_id for t in frames])
        for transform in frames:
            T = pose_of(*matrix(transform.transform))
            assert T[:3, 3] == pytest.approx([1.25, 0.2, 0.7]), "the middle"
            assert T[:3, 2] == pytest.approx(UP), "z along the normal"
            assert abs(T[0, 0]) == pytest.approx(1.0), "x along the longer edge"
    assert found == [["surface_0"], ["surface_0"], ["surface_0", "surface_1"]]


def pose_of(t, q):
    T = np.eye(4)
    x, y, z, w = q
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = t
    return T


def test_poses_of_the_bag_equal_the_solution_with_keyframe_covariances(messages, cycles):
    expected = solution(cycles)
    for index, (_, message) in enumerate(messages["/pose"]):
        t, q = matrix(message.pose.pose)
        assert np.allclose(t[:2], expected.trajectory[index, :2], atol=1e-12)
        assert np.allclose(q, quaternion(spatial(expected.trajectory[index])), atol=1e-12)
        cov = np.reshape(message.pose.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
        if expected.trajectory_ns[index] < 14 * S:
            assert np.array_equal(cov, np.eye(3) * 0.01)
            continue
        # Along the keyframe's x axis, as seen in map.
        yaw = expected.graph.keyframes[1].pose[2]
        along = np.array([np.cos(yaw), np.sin(yaw)])
        assert along @ cov[:2, :2] @ along == pytest.approx(ALONG[0, 0])
        assert np.trace(cov) == pytest.approx(np.trace(ALONG))


def test_the_map_cloud_loses_the_oldest_cycle_after_the_window(messages):
    """Cell rows at y = 0, 1 and 2: of a window of two cycles the oldest is gone."""
    seen = []
    for _, message in messages["/tccm/map_cloud"]:
        rows = np.frombuffer(message.data, np.float32).reshape(message.width, -1)
        seen.append(sorted({int(y) for y in rows[:, 1]}))
    assert seen == [[0], [0, 1], [1, 2]]


def test_surfaces_appear_at_the_time_when_they_were_first_seen(messages, cycles):
    log, arrays = zip(*messages["/surface_slam/surfaces"])
    assert list(log) == [cycles[0].end_ns, cycles[2].end_ns, 23 * S + S // 2]
    outlines = [{i for ns, i in shown(a) if ns == "outline"} for a in arrays]
    assert outlines == [{0}, {0, 1}, {0, 1}]
    points = [m.width for _, m in messages["/surface_slam/surface_cloud"]]
    assert points == [8], "the whole cloud once"


def test_markers_of_lost_planes_are_deleted(messages):
    first, second, _ = (m for _, m in messages["/tccm/planes"])
    assert {i for _, i in shown(first)} == {0}
    assert {i for _, i in shown(second)} == {1}
    assert {m.id for m in second.markers if m.action == 2} == {0}


def test_writing_again_gives_the_same_bytes(bag, cycles):
    before = bag.read_bytes()
    write(bag, cycles, solution(cycles))
    assert bag.read_bytes() == before


@pytest.mark.parametrize("kind", ["no cycles", "no level scans", "nothing"])
def test_a_recording_without_cycles_or_level_scans_gives_a_bag(cycles, tmp_path, kind):
    some = [] if kind != "no level scans" else cycles
    scans = 0 if kind != "no cycles" else 30
    write(tmp_path / "r.mcap", some, solution(some, scans))
    with (tmp_path / "r.mcap").open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert ("/tccm/planes" in topics) == bool(some)
    assert ("/pose" in topics) == bool(scans)
    assert ("/surface_slam/walls" in topics) == (kind != "nothing")


def test_a_path_that_cannot_be_written_is_an_error(cycles, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        write(tmp_path / "file" / "r.mcap", cycles, solution(cycles))
