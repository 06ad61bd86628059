"""A Rerun server without a viewer, which writes all that it receives to an .rrd."""

import io
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

SERVER = Path(sys.executable).parent / "rerun"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


class RerunServer:
    """Runs until it is closed; then `store` has its content."""

    def __init__(self, port: int, file: Path):
        self.port, self.file = port, file
        words = ["--save", str(file), "--bind", "127.0.0.1", "--port", str(port)]
        self._process = subprocess.Popen(
            [SERVER, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        self._process.communicate(timeout=60)

    def store(self):
        """Return what was received, as chunks."""
        from rerun.chunk import RrdReader

        return RrdReader(self.file).stream().collect()


def rows(store, entity, component, index="stamp"):
    """Return the stamps, s, and values of a component of an entity."""
    table = store.reader(index=index, contents=entity).to_arrow_table()
    [name] = [n for n in table.column_names if n.endswith(component)]
    values = table.column(name).to_pylist()
    if index is None:
        return values
    stamps = table.column(index).cast("int64").to_numpy() * 1e-9
    kept = [k for k, value in enumerate(values) if value is not None]
    return stamps[kept], [values[k] for k in kept]


def transforms(store, entity):
    stamps, moved = rows(store, entity, "Transform3D:translation")
    _, turned = rows(store, entity, "Transform3D:mat3x3")
    T = np.tile(np.eye(4), (len(stamps), 1, 1))
    T[:, :3, 3] = np.array(moved).reshape(-1, 3)
    # Rerun stores a matrix column by column.
    T[:, :3, :3] = np.array(turned).reshape(-1, 3, 3).transpose(0, 2, 1)
    return stamps, T


def last_at(stamps, stamp):
    """Return the index of the newest of some stamps at another."""
    return np.searchsorted(stamps, stamp + 1e-6) - 1


def in_map(store, entity, stamp, points):
    """Return points (N, 3) of a frame on the base in map."""
    T = np.eye(4)
    for frame in ("/map/odom", "/map/odom/base", entity):
        stamps, poses = transforms(store, frame)
        T = T @ poses[last_at(stamps, stamp)]
    return points @ T[:3, :3].T + T[:3, 3]


def depth_points(store, camera):
    """Return the stamps, s, of a camera's depth images and their points (N, 3) in its frame, m."""
    stamps, blobs = rows(store, f"{camera}/depth", "EncodedDepthImage:blob")
    [K] = rows(store, camera, "Pinhole:image_from_camera", index=None)[0]
    to_ray = np.linalg.inv(np.reshape(K, (3, 3)).T).T
    found = []
    for blob in blobs:
        depth = np.array(Image.open(io.BytesIO(bytes(np.ravel(blob).tolist())))) * 1e-3
        v, u = np.nonzero(depth)
        found.append(np.stack([u, v, np.ones(len(v))], axis=1) @ to_ray * depth[v, u, None])
    return stamps, found


def views(file):
    """Return the names of the views of each blueprint."""
    from rerun.chunk import RrdReader

    reader = RrdReader(file)
    return [_names(reader.stream(store=blueprint)) for blueprint in reader.blueprints()]


def _names(blueprint):
    shown = [c for c in blueprint.to_chunks() if "/view/" in c.entity_path]
    tables = [c.to_record_batch() for c in shown]
    column = "ViewBlueprint:display_name"
    return {
        name
        for table in tables
        if column in table.schema.names
        for [name] in table.column(column).to_pylist()
    }
