"""Errors of a map's walls and surfaces against the truth beside a simulated recording."""

import json

import numpy as np
import shapely

MAX_STEP = 0.03
"""Max difference in height of a top and its surface, m: two tops of the flat differ by 0.05 m."""


def wall_errors(folder, truth):
    """Return the distance of each wall's ends from the nearest parallel true wall, m."""
    walls = json.loads((folder / "walls.json").read_text())["walls"]
    true = json.loads((truth / "truth_walls.json").read_text())["walls"]
    lines = [(np.array(w["endpoints"]), shapely.LineString(w["endpoints"])) for w in true]
    errors = []
    for wall in walls:
        ends = np.array(wall["endpoints"])
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        middle = shapely.Point(ends.mean(axis=0))
        distances = []
        for points, line in lines:
            along = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
            if abs(along @ direction) > 0.97 and line.distance(middle) < 0.3:
                normal = np.array([-along[1], along[0]])
                distances.append(np.abs((ends - points[0]) @ normal).max())
        if distances:
            errors.append(min(distances))
    return np.array(errors)


def surface_errors(folder, truth):
    """Return the error of each true top's centre (m, over the parts seen) and of its height, m.

    A top is that of the surface that overlaps it most; the counts are of surfaces at its place.
    """
    found = json.loads((folder / "surfaces.json").read_text())["surfaces"]
    true = json.loads((truth / "truth.json").read_text())["surfaces"]
    polygons = [shapely.make_valid(shapely.Polygon(np.array(s["boundary"])[:, :2])) for s in found]
    heights, counts = [], []
    for top in true:
        outline = shapely.Polygon(np.array(top["boundary"])[:, :2])
        same = [
            (polygon.intersection(outline).area, k)
            for k, polygon in enumerate(polygons)
            if abs(found[k]["height"] - top["height"]) < MAX_STEP
            and polygon.intersection(outline).area > 0.1 * outline.area
        ]
        counts.append(len(same))
        if same:
            heights.append(abs(found[max(same)[1]]["height"] - top["height"]))
    return np.array(heights), np.array(counts)
