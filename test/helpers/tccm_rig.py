"""A tilting laser in closed form, for tests of the TCCM, without simulator and package code."""

from dataclasses import replace

import numpy as np
from hypothesis import settings

from tccm_ros.baselines.union_as_printed import AS_PRINTED
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import cell_keys, key_cells
from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.cuboids.union import UNION
from tccm_ros.records import PosedScan, Scan

HEIGHT = 1.52

exactly = settings(deadline=None, max_examples=60)
"""Settings of a property test; the first example may compile kernels."""


def config(**map_settings):
    """Return a configuration; by default cells of 20 mm and a fixed depth of 30 mm."""
    settings = {"gap": "fixed", **map_settings}
    return Config.model_validate({"map": settings})


def rotation_y(angle):
    """Return T (4, 4) that turns x down for a positive angle (a laser that tilts down)."""
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return T


def laser_pose(angle):
    """Return T_base_laser at a tilt angle: the axis goes through the laser, HEIGHT above."""
    T = rotation_y(angle)
    T[2, 3] = HEIGHT
    return T


def floor_ranges(bearings, angle, z=0.0, x_wall=3.0):
    """Return the ranges to a floor at z and a wall at x_wall, by similar triangles."""
    forward = np.cos(bearings)
    down = forward * np.sin(angle)
    ahead = forward * np.cos(angle)
    with np.errstate(divide="ignore"):
        to_floor = np.where(down > 0, (HEIGHT - z) / down, np.inf)
        to_wall = np.where(ahead > 0, x_wall / ahead, np.inf)
    return np.minimum(to_floor, to_wall)


def make_scan(stamp_ns, ranges, angle_min=-1.0, increment=0.02, time_increment=0.0):
    """Return a Scan of ranges."""
    return Scan(
        stamp_ns, "laser", angle_min, increment, time_increment, 0.02, 30.0,
        np.asarray(ranges, np.float32),
    )  # fmt: skip


def posed(scan, angle, T_odom_base=None, angle_end=None, T_odom_base_end=None):
    """Return a PosedScan between two tilt angles (one if all beams have one time)."""
    T0 = np.eye(4) if T_odom_base is None else T_odom_base
    if scan.end_ns == scan.stamp_ns:
        return PosedScan(scan, np.array([scan.stamp_ns]), T0[None], laser_pose(angle)[None])
    T1 = T0 if T_odom_base_end is None else T_odom_base_end
    end = angle if angle_end is None else angle_end
    return PosedScan(
        scan,
        np.array([scan.stamp_ns, scan.end_ns]),
        np.stack([T0, T1]),
        np.stack([laser_pose(angle), laser_pose(end)]),
    )


def part_of(points_ticks, cycle, settings):
    """Return the part map of integer points (ticks)."""
    builder = PartMapBuilder(settings, AS_PRINTED if settings.map.mode == "paper" else UNION)
    if len(points_ticks):
        builder.add_points(np.asarray(points_ticks, float).reshape(-1, 3) * 1e-4)
    return builder.close(cycle, cycle * 10, cycle * 10 + 9)


def as_dict(part):
    """Return a part map in the format of `interval_oracle`."""
    ix, iy = key_cells(part.keys)
    result = {}
    for x, y, (bottom, top), moments in zip(
        ix.tolist(), iy.tolist(), part.bounds.tolist(), part.moments.tolist(), strict=True
    ):
        result.setdefault((x, y), []).append((bottom, top, tuple(moments)))
    return result


def void_part(part, voids):
    """Return a part map with the voids {(ix, iy): [(bottom, top)]}."""
    rows = [(x, y, b, t) for (x, y), found in sorted(voids.items()) for b, t in sorted(found)]
    ix, iy, bottom, top = (np.array(c, np.int64) for c in zip(*rows, strict=True))
    return replace(
        part,
        void_keys=cell_keys(ix, iy),
        void_bounds=np.column_stack([bottom, top]).astype(np.int32),
    )


def snapshot(map_):
    """Return every byte of a map."""
    c = map_.cuboids()
    arrays = (map_.keys, map_.pieces, c.ix, c.iy, c.bottom, c.top, c.count, c.s, c.S, c.cycles)
    return [a.tobytes() for a in (*arrays, c.cycle_offsets)]


def filled(settings, parts):
    """Return the map of some part maps."""
    map_ = IntegrationMap(settings)
    for part in parts:
        map_.add(part)
    return map_
