"""The map of running nodes in a Rerun server: all of it, whenever the server comes."""

import threading

import numpy as np
import pytest

from tccm_ros.errors import ConfigError
from tccm_ros.records import PosedScan, Scan
from tccm_ros.view.live_state import path_entity, surface_entity

pytest.importorskip("rerun", reason="rerun-sdk (the extra 'view') is missing")
pytest.importorskip("datafusion", reason="rerun's dataframes need rerun-sdk[catalog]")
pytestmark = pytest.mark.filterwarnings("ignore:RRD file has no footer")

from rerun_server import RerunServer, free_port, rows  # noqa: E402

from tccm_ros.view import rerun_stream  # noqa: E402
from tccm_ros.view.rerun_stream import RerunStream  # noqa: E402

SQUARE = np.array([[0.0, 0, 0.7], [1.2, 0, 0.7], [1.2, 0.8, 0.7], [0, 0.8, 0.7]])


def surface(number, label="table"):
    facts = {"id": number, "label": label, "height": 0.7}
    return surface_entity(facts, SQUARE, [], np.array([0.0, 0, 1]), [0.6, 0.4, 0.7])


MAP = {
    "world": {"ground": 0.1, "start": 0.0, "extent": [[-1.0, -1.0], [4.0, 3.0]]},
    "surface/3": surface(3),
    "surface/4": surface(4, "floor"),
    "wall/0": {"id": 0, "ends": [[-0.5, -0.5], [3.0, -0.5]]},
    "object/7": {"corners": [[0.1, 0.1], [0.2, 0.1], [0.2, 0.2], [0.1, 0.2]],
                 "low": 0.7, "high": 0.9},
    "sign/2": {"id": 2, "text": "Room 12", "at": [1.0, -0.5, 1.5], "normal": [0.0, 1.0, 0.0]},
    "free/3": {"on": "table", "v": [], "rings": []},
    "path": path_entity(np.array([[2.0, 0.0], [2.5, 1.0]])),
}  # fmt: skip


def show(stream, stamp_s, entities, pose, *events):
    """Change the state, and wait until the thread has sent it."""

    def change(state):
        state.entities, state.pose, state.stamp_ns = dict(entities), pose, round(stamp_s * 1e9)
        for event in events:
            state.add_event(event)

    stream.update(change)


@pytest.fixture
def sent(monkeypatch):
    """Released after each delta that was written, with it."""
    written, write = threading.Semaphore(0), rerun_stream.write_delta

    def note(*args):
        write(*args)
        if args[1]:
            written.release()

    monkeypatch.setattr(rerun_stream, "write_delta", note)
    monkeypatch.setattr(rerun_stream, "RETRY_S", 0.1)
    return written


def test_a_server_that_comes_late_gets_the_map_then_the_changes(tmp_path, sent):
    port = free_port()
    stream = RerunStream(f"rerun+http://127.0.0.1:{port}/proxy")
    show(stream, 4.0, {}, [0.0, 0.0, 0.0])
    show(stream, 5.0, MAP, [2.5, 1.0, 0.3], "appeared: table 3")
    assert not sent.acquire(timeout=0.5), "there is nobody yet"
    server = RerunServer(port, tmp_path / "a.rrd")
    assert sent.acquire(timeout=120.0)
    changed = {**MAP, "surface/3": surface(3, "counter")}
    del changed["object/7"]
    show(stream, 6.0, changed, [3.0, 1.0, 0.4])
    assert sent.acquire(timeout=120.0)
    stream.close()
    server.close()
    store = server.store()
    stamps, strips = rows(store, "/map/surfaces/3/outline", "LineStrips3D:strips")
    assert stamps.tolist() == [5.0, 6.0]
    np.testing.assert_allclose(strips[0][0][:-1], SQUARE)
    _, names = rows(store, "/map/surfaces/3/name", "Points3D:labels")
    assert names == [["table 3, 0.70 m"], ["counter 3, 0.70 m"]]
    stamps, texts = rows(store, "/map/signs/2", "Arrows3D:labels")
    assert (stamps.tolist(), texts) == ([5.0], [["Room 12"]])
    # What has not changed is not sent again.
    assert rows(store, "/map/surfaces/4/outline", "LineStrips3D:strips")[0].tolist() == [5.0]
    stamps, places = rows(store, "/map/base", "Transform3D:translation")
    assert stamps.tolist() == [5.0, 6.0]
    np.testing.assert_allclose(np.squeeze(places), [[2.5, 1, 0.1], [3, 1, 0.1]], atol=1e-6)
    _, walls = rows(store, "/map/walls/0", "LineStrips3D:strips")
    np.testing.assert_allclose(np.array(walls[0][0])[:, 2], [0.1, 0.1, 1.0, 1.0, 0.1], atol=1e-6)
    # A query hides what clears an entity.
    last = [c for c in store.stream().to_chunks() if c.entity_path == "/map/objects/7"][-1]
    assert "Clear:is_recursive" in str(last)
    assert rows(store, "/events", "TextLog:text")[1] == [["appeared: table 3"]]


def test_log_without_a_server_does_not_block(sent):
    stream = RerunStream(f"rerun+http://127.0.0.1:{free_port()}/proxy")
    for k in range(1000):
        show(stream, k, MAP, [0.0, 0.0, 0.001 * k])
    stream.close()
    assert not sent.acquire(blocking=False)


def test_a_server_that_ends_and_comes_again_gets_everything(tmp_path, sent):
    port = free_port()
    server = RerunServer(port, tmp_path / "a.rrd")
    stream = RerunStream(f"rerun+http://127.0.0.1:{port}/proxy")
    show(stream, 5.0, MAP, [0.0, 0.0, 0.0])
    assert sent.acquire(timeout=120.0)
    server.close()
    server, count = RerunServer(port, tmp_path / "b.rrd"), 0
    while not (tmp_path / "b.rrd").exists() or (tmp_path / "b.rrd").stat().st_size < 5000:
        count += 1
        assert count < 200
        show(stream, 6.0 + count, MAP, [0.1 * count, 0.0, 0.0])
        assert sent.acquire(timeout=120.0)
    stream.close()
    server.close()
    assert len(rows(server.store(), "/map/surfaces/3/outline", "LineStrips3D:strips")[0]) == 1


def posed_scan(stamp_ns, distance):
    """Return a scan of some beams of one length, m, by a laser at rest."""
    scan = Scan(stamp_ns, "laser", 0.0, 0.1, 0.0, 0.05, 30.0, np.full(5, distance, np.float32))
    still = np.eye(4)[None]
    return PosedScan(scan, np.array([stamp_ns]), still, still, "scan")


def test_measurements_faster_than_the_viewer_rate_show_the_newest(tmp_path, sent):
    """What keeps the rate of each sensor, and the memory without a viewer, bounded."""
    port = free_port()
    stream = RerunStream(f"rerun+http://127.0.0.1:{port}/proxy")
    for k in range(500):
        stream.add(posed_scan(round(k * 1e7), 1.0 + 0.01 * k))
    show(stream, 5.0, MAP, [0.0, 0.0, 0.0])
    server = RerunServer(port, tmp_path / "a.rrd")
    assert sent.acquire(timeout=120.0)
    stream.close()
    server.close()
    stamps, scans = rows(server.store(), "/map/odom/scan", "Points3D:positions")
    assert stamps.tolist() == [4.99]
    np.testing.assert_allclose(np.linalg.norm(scans[0], axis=1), 5.99, rtol=1e-6)


@pytest.mark.parametrize(
    "url", ["127.0.0.1:9876", "http://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1/proxy",
            "rerun+http://127.0.0.1:9876", "rerun+http://127.0.0.1:x/proxy"]
)  # fmt: skip
def test_an_address_of_another_kind_is_named(url):
    with pytest.raises(ConfigError, match=r"view\.rerun is .*; expected rerun\+http://HOST:PORT"):
        RerunStream(url)
