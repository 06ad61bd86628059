"""surfaces.ply, read by a reader of its own."""

import numpy as np

from tccm_ros.results.ply import surface_ply

TYPES = {"float": "<f4", "uchar": "u1", "uint": "<u4"}


def read(content):
    """Return the vertices of a binary PLY file, a structured array with the names in its header."""
    header, _, body = content.partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    fields = [line.split()[1:] for line in lines if line.startswith("property")]
    rows = np.frombuffer(body, np.dtype([(name, TYPES[kind]) for kind, name in fields]))
    assert f"element vertex {len(rows)}" in lines
    return rows


def example():
    rng = np.random.default_rng(0)
    return rng.normal(size=(60, 3)).astype(np.float32), np.repeat([7, 3, 12], 20).astype(np.uint32)


def test_points_and_their_surfaces_are_in_the_file():
    points, ids = example()
    rows = read(surface_ply(points, ids))
    assert rows["surface_id"].tolist() == ids.tolist()
    # Coordinates are rounded to 1e-6 m.
    written = np.stack([rows[axis] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(written, points, atol=1e-6)


def test_each_surface_has_one_colour_of_its_own():
    points, ids = example()
    rows = read(surface_ply(points, ids))
    colors = np.stack([rows[name] for name in ("red", "green", "blue")], axis=1).astype(int)
    found = [np.unique(colors[ids == i], axis=0) for i in np.unique(ids)]
    assert [len(each) for each in found] == [1, 1, 1]
    gaps = [abs(a - b).sum() for n, a in enumerate(found) for b in found[n + 1 :]]
    assert min(gaps) > 60, "a person can tell them from each other"


def test_a_map_without_surfaces_is_a_file_without_points():
    assert len(read(surface_ply(np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)))) == 0
