"""Errors of a map's walls and surfaces relative to the truth of a simulated recording."""

import json

import numpy as np
import shapely
from scipy.optimize import least_squares

from tccm_ros.geometry import transform2

MAX_STEP = 0.03
"""Max difference in height of a top and its surface, m: two tops of the flat differ by 0.05 m."""


MAX_WALL_DISTANCE = 0.3
"""Max distance of a wall's middle from its true face, m."""


def wall_errors(folder, truth, *, fitted=False):
    """Return the distance of each wall's ends from the nearest parallel true face, m.

    Faces are those of walls and of furniture, which a level laser cannot distinguish. With `fitted`
    the whole map is first aligned with the truth: its frame is that of the first pose, whose yaw is
    as uncertain as the odometry.
    """
    faces = _faces(truth)
    walls = [np.array(w["endpoints"]) for w in _read(folder / "walls.json")["walls"]]
    if fitted:
        pairs = [(ends, face) for ends in walls if (face := _nearest(ends, faces))]

        def distances(pose):
            moved = [transform2(pose, ends) for ends, _ in pairs]
            return np.concatenate([_offsets(m, face) for m, (_, face) in zip(moved, pairs)])

        pose = least_squares(distances, np.zeros(3), loss="soft_l1", f_scale=0.01).x
        walls = [transform2(pose, ends) for ends in walls]
    found = [(ends, _nearest(ends, faces)) for ends in walls]
    return np.array([np.abs(_offsets(ends, face)).max() for ends, face in found if face])


def _read(path):
    return json.loads(path.read_text())


def _faces(truth):
    """Return the ends of each vertical face, with the line between them."""
    faces = [np.array(w["endpoints"]) for w in _read(truth / "truth_walls.json")["walls"]]
    for top in _read(truth / "truth.json")["surfaces"]:
        ring = np.array(top["boundary"])[:, :2]
        faces += list(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
    return [(ends, shapely.LineString(ends)) for ends in faces]


def _nearest(ends, faces):
    """Return the parallel face near a wall's middle that is nearest to its ends, or None."""
    middle = shapely.Point(ends.mean(axis=0))
    near = [
        face
        for face in faces
        if abs(_direction(face[0]) @ _direction(ends)) > 0.97
        and face[1].distance(middle) < MAX_WALL_DISTANCE
    ]
    return min(near, key=lambda face: np.abs(_offsets(ends, face)).max(), default=None)


def _direction(ends):
    return (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])


def _offsets(ends, face):
    x, y = _direction(face[0])
    return (ends - face[0][0]) @ np.array([-y, x])


def surface_errors(folder, truth):
    """Return the height error of each found true top, m, and the number of surfaces of each top.

    A top is matched with the surface that overlaps it most; the count is of surfaces at its place.
    """
    tops = _read(truth / "truth.json")["surfaces"]
    found = surfaces_of_tops(folder, truth)
    heights = [abs(same[0]["height"] - top["height"]) for top, same in zip(tops, found) if same]
    return np.array(heights), np.array(list(map(len, found)))


def surfaces_of_tops(folder, truth):
    """Return the surfaces at the place of each true top, by falling overlap."""
    found = _read(folder / "surfaces.json")["surfaces"]
    polygons = [shapely.make_valid(shapely.Polygon(np.array(s["boundary"])[:, :2])) for s in found]
    tops = []
    for top in _read(truth / "truth.json")["surfaces"]:
        outline = shapely.Polygon(np.array(top["boundary"])[:, :2])
        areas = [polygon.intersection(outline).area for polygon in polygons]
        same = [
            k
            for k in np.argsort(areas)[::-1]
            if areas[k] > 0.1 * outline.area and abs(found[k]["height"] - top["height"]) < MAX_STEP
        ]
        tops.append([found[k] for k in same])
    return tops
