"""Each parameter of the algorithms changes a result on some input.

A parameter that changes nothing promises what is not there. An input is a stage of the pipeline on
simulated records; its digest holds what is saved and published: planes, objects, free places, the
map, surface messages; trajectory, walls, loop closures; surfaces and their labels.
"""

import hashlib
import itertools
import json
from dataclasses import replace
from functools import cache

import numpy as np
import plan
import pytest
from fed import fed_tccm
from furniture import noisy_surface
from mapped_room import BOX, FLOOR, HALF_TIME, TABLE, WALL, ns, record, settings
from object_boxes import objects_of
from room import Board, Room
from shapely import affinity, box
from shared_data import shared

from tccm_ros.bags.reader import BagReader
from tccm_ros.config import Config, parameters
from tccm_ros.cuboids.timed_cycles import TimedCycles
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import (
    JointSample,
    Odometry,
    PosedScan,
    SurfaceCloud,
    ViewIntervals,
)
from tccm_ros.slam.wall_slam import WallSlam
from tccm_ros.surfaces.labels.labels import label_surfaces
from tccm_ros.surfaces.objects.object_tracks import track_objects
from tccm_ros.surfaces.views.views import empty_view, with_intervals, with_objects
from tccm_sim.carmen import import_carmen

GROUPS = (
    "cycle", "map", "planes", "center_core", "objects", "lines", "matching", "odometry", "walls",
    "graph", "loops", "views", "surfaces", "labels",
)  # fmt: skip
"""Those of the algorithms; the others are about frames, sensors, nodes and files."""


def digest(*values):
    """Return a short name of arrays, numbers and lists of them."""
    state = hashlib.sha256()

    def add(value):
        if isinstance(value, np.ndarray):
            state.update(str(value.shape).encode() + np.ascontiguousarray(value).tobytes())
        elif isinstance(value, (list, tuple)):
            state.update(b"[")
            for item in value:
                add(item)
        else:
            state.update(repr(value).encode())

    add(values)
    return state.hexdigest()[:12]


# -- inputs -------------------------------------------------------------------------------------


def changing_boxes(t):
    """A table that is gone in one tilt cycle and comes back 1 cm higher; its box moves twice."""
    if HALF_TIME < t < 2 * HALF_TIME:
        return FLOOR, WALL
    lift, move = ((0.0, 0.0), (0.01, 0.08))[t > 2 * HALF_TIME]
    move += 0.05 * (t > 3 * HALF_TIME)
    x = [0, 0, 0, 0, lift, lift], [0, 0, move, move, lift, lift]
    small = (1.5, 1.56, 0.3, 0.36, 0.7 + lift, 0.76 + lift)
    return FLOOR, WALL, tuple(np.add(TABLE, x[0])), tuple(np.add(BOX, x[1])), small


@cache
def changing_room(drive=(0.0, 0.0)):
    return record(4 * HALF_TIME, changing_boxes, drive, noise=0.002, every=3)


@cache
def unsteady_tilt():
    """A joint that rests, trembles and falls silent for a while, each for less than the limits."""
    records, rest = [], 0.0
    for item in record(3 * HALF_TIME, lambda t: (FLOOR, WALL, TABLE), noise=0.002, every=6):
        if isinstance(item, JointSample):
            t = (item.stamp_ns - ns(0.0)) / 1e9
            angle = float(item.positions[0])
            if 0.3 < t < 0.6:
                continue
            if 1.9 < t < 2.2:
                angle = rest
            rest = angle
            angle += 0.03 * (3.0 < t < 3.1)
            item = replace(item, positions=np.array([angle]))
        records.append(item)
    return records


def tccm(records, config):
    fed = fed_tccm(config)
    results = [r for item in records for r in fed.add(item)] + fed.finish()
    cuboids = fed.processor.map.cuboids()
    return digest(
        [
            [
                [r.cycle, r.stamp_ns, r.scans, r.ended_by],
                [[p.id, p.kind, p.normal, p.offset, p.boundary] for p in r.planes],
                [[o.id, o.center, o.size] for o in r.objects],
                [r.surfaces.points, r.surfaces.surface, r.view.intervals],
            ]
            for r in results
        ],
        [cuboids.ix, cuboids.iy, cuboids.top, cuboids.bottom, cuboids.count],
    )


def cycles_by_time(config):
    """Return the spans of cycles where no laser tilts."""
    cycles = TimedCycles(config, itertools.count())
    for stamp in range(0, 5 * 10**9, 10**8):
        cycles.advance_to(stamp, np.eye(4))
    return digest([[span.start_ns, span.end_ns] for span in cycles.closed])


def tracked(config):
    """Return what is left of an object that one more view looked through."""
    rows = np.array([[1.05, 0.05, 0.5, 1.5]], np.float32)
    boxes = objects_of(1, [(1.05, 0.05, 0.8, 0.04, 0.04, 0.04, 0.0)])
    seen = [with_objects(empty_view(k, 0, config), boxes) for k in (1, 2)]
    through = with_intervals(empty_view(3, 0, config), ViewIntervals(3, "base", rows))
    poses = np.broadcast_to(np.eye(4), (3, 4, 4))
    return digest([t.id for t in track_objects([*seen, through], poses, config).tracks])


LAP = [(0, 0), (12, 0), (12, 9), (0, 9), (0, 0), (4, 0)]


BENT = np.array([[[2.0, -1.0], [6.0, -0.75]]])
"""A wall that goes on from another at an angle of 0.06 rad."""


BOX_LATER = plan.box(3.0, -0.6, 3.6, -0.2)
"""What stands in the corridor when the robot comes back."""


@cache
def lap():
    here = np.concatenate([plan.ring(), BENT])
    before, after = (
        plan.drive(plan_of, plan.route(LAP, step=0.2), seed=3)
        for plan_of in (here, np.concatenate([here, BOX_LATER]))
    )
    half = len(before.scans) // 2
    return replace(before, scans=before.scans[:half] + after.scans[half:])


@cache
def slipping():
    """Odometry that misses a step of 10 cm, and one of half a metre and 0.3 rad."""
    run = plan.drive(plan.ring(), plan.route(LAP[:3], step=0.2), seed=3)
    for begin, slip in ((20, [0.1, 0.05, 0.0]), (40, [0.5, -0.2, 0.3])):
        for scan in run.scans[begin:]:
            scan.T_odom_base[:] = plan.matrix(slip) @ scan.T_odom_base
    return run


@cache
def saved_lap():
    slam = WallSlam(Config())
    for scan in lap().scans:
        slam.add_scan(scan)
    return slam.saved()


def walls(config, saved=None, run=None):
    slam = SurfaceSlam(config).wall_slam
    run = run or lap()
    if saved is not None:
        slam = WallSlam.from_saved(config, saved)
        run = plan.drive(plan.ring(), plan.route([(12, 4), (12, 9), (8, 9)]), start_ns=2 * 10**18)
    for scan in run.scans:
        slam.add_scan(scan)
    solution = slam.solve(run.stamps_ns[10::60])
    return digest(
        solution.poses,
        [[w.phi, w.rho, w.endpoints, w.observations] for w in solution.walls],
        [[p.from_id, p.to_id, p.reason, p.accepted] for p in solution.loops],
        solution.cov_keyframes,
    )


KITCHEN = Room(
    [
        Board(1.5, 0.0, 0.6, 1.8, 0.90),
        Board(1.5, 0.4, 0.4, 0.4, 0.92),
        Board(1.3, -1.6, 0.5, 0.5, 0.46),
        Board(1.3, 1.6, 0.3, 0.3, 0.27),
        Board(1.4, 1.05, 0.3, 0.2, 0.90),
    ]
)
MOVED = Room([*KITCHEN.boards[:1], Board(1.5, 0.42, 0.4, 0.4, 0.96), *KITCHEN.boards[3:]])
LOOKS = [
    (KITCHEN, (0.0, 0.0, 0.0), 10**18),
    (MOVED, (0.06, 0.02, 0.05), 10**18 + 10**9),
    (MOVED, (0.5, 0.6, -0.3), 10**18 + 2 * 10**9),
]


@cache
def views():
    return [r for room, pose, stamp in LOOKS for r in room.look(pose, stamp, noise=0.004)]


def surfaces(config, viewpoint=None):
    slam = SurfaceSlam(config)
    drive = plan.drive(plan.box(-3, -3, 4, 3), np.array([pose for _, pose, _ in LOOKS]), beams=361)
    for scan, (_, _, stamp) in zip(drive.scans, LOOKS, strict=True):
        at = replace(scan.record, stamp_ns=stamp)
        slam.wall_slam.add_scan(replace(scan, record=at, pose_stamps_ns=np.array([stamp])))
    for item in views():
        is_cloud = isinstance(item, SurfaceCloud)
        slam.add(replace(item, viewpoint=viewpoint) if is_cloud else item)
    solution = slam.solve()
    mapped = solution.mapped
    return digest(
        [
            [s.id, s.label, s.confidence, s.height, s.boundary, list(s.holes)]
            for s in mapped.surfaces
        ],
        mapped.floor_z,
        mapped.points,
        [[k, rings] for k, rings in sorted(solution.free_places.items())],
        [list(space) for space in solution.unseen],
    )


SCENES = [
    [(box(0, 0, 1.4, 0.8), 0.74)],
    [(box(0, 0, 2.4, 0.6), 0.91), (box(0.8, 0.05, 1.4, 0.55), 0.96)],
    [(box(0, 0, 1.1, 0.6), 0.42)],
    [(box(0, 0, 0.45, 0.42), 0.45)],
    [(box(0, 0, 1.9, 0.6), 0.44), (box(-0.1, 0.61, 2.0, 0.8), 0.8)],
    [(box(0, 0, 2.0, 0.9), 0.5)],
    [(box(0, 0, 0.8, 0.3), z) for z in (0.35, 0.7, 1.05, 1.4)],
    [(box(0, 0, 1.2, 0.2), 0.9)],
    [(box(0.27 * k, 0, 0.27 * k + 0.26, 0.9), 0.17 * (k + 1)) for k in range(2, 8)],
    [(box(0, 0, 1.2, 0.42), 0.45)],
    [(box(0, 1.0, 1.1, 1.6), 0.42)],
    [(box(0, 0, 1.3, 0.44), 0.76)],
    [(box(0, 0, 0.42, 0.42), 0.485)],
]
WALL_LINE = np.array([[[-3.0, -0.05], [6.0, -0.05]]])


def labels(config):
    rng = np.random.default_rng(1)
    scenes = [[noisy_surface(affinity.rotate(p, 0.0), z, rng) for p, z in one] for one in SCENES]
    found = [label_surfaces(one, 0.0, WALL_LINE, config) for one in scenes]
    return digest([[(label.name, label.confidence) for label in one] for one in found])


# -- the inputs on which parameters act ----------------------------------------------------------

DRIVE = (0.15, 0.1)
STAGES = {
    "room": lambda c: tccm(changing_room(), c),
    "driving": lambda c: tccm(changing_room(DRIVE), c),
    "unsteady": lambda c: tccm(unsteady_tilt(), c),
    "timed": cycles_by_time,
    "walls": walls,
    "slipping": lambda c: walls(c, run=slipping()),
    "saved walls": lambda c: walls(c, saved_lap()),
    "surfaces": surfaces,
    "seen from": lambda c: surfaces(c, np.float32([0.0, 0.0, 1.2])),
    "tracked": tracked,
    "labels": labels,
}

ONE = {"map.window_cycles": 1}
CORES = {"planes.detector": "center_cores", "map.cell_size": 0.04}
SEED = {"surfaces.segmentation": "seed", "surfaces.min_points": 100}
RANSAC = {"lines.extractor": "ransac"}
REGION = {"map.region": (0.3, 2.0, -0.8, 0.8, -0.1, 1.4)}
NOWHERE = (9.0, 9.1, 0.1, 0.2, 0.1, 0.2)

CASES = {
    "cycle.dead_band": ("unsteady", 0.5, {"cycle.min_sweep": 0.01}),
    "cycle.min_sweep": ("unsteady", 2.0, {}),
    "cycle.rest_time": ("unsteady", 0.2, {}),
    "cycle.max_gap": ("unsteady", 0.2, {}),
    "cycle.max_time": ("unsteady", 1.0, {}),
    "cycle.period": ("timed", 2.0, {}),
    "map.cell_size": ("room", 0.03, {}),
    "map.window_cycles": ("room", 2, {}),
    "map.cuboid_depth": ("room", 0.1, {"map.gap": "fixed"}),
    "map.gap": ("room", "fixed", {}),
    "map.gap_factor": ("room", 4.0, {}),
    "map.max_depth": ("room", 0.05, {}),
    "map.mode": ("room", "paper", {}),
    "map.region": ("room", REGION["map.region"], {}),
    "map.region_frame": ("driving", "odom", REGION),
    "map.clear_seen_through": ("room", True, {}),
    "planes.detector": ("room", "neighbours", {}),
    "planes.source": ("room", "part", {}),
    "planes.height_threshold": ("room", 0.002, {"planes.detector": "neighbours"}),
    "planes.horizontal_angle": ("room", 0.0005, {}),
    "planes.min_points": ("room", 2000, {}),
    "planes.min_area": ("room", 2.0, {}),
    "planes.max_rms": ("room", 0.0015, {}),
    "planes.flatness": ("room", 0.001, {}),
    "planes.track_distance": ("room", 0.001, ONE),
    "planes.track_angle": ("room", 1e-5, ONE),
    "planes.track_cycles": ("room", 0, ONE),
    "center_core.trials": ("room", 3, CORES),
    "center_core.cores": ("room", 5, CORES),
    "center_core.min_quality": ("room", 1e6, CORES),
    "center_core.angle_threshold": ("room", 0.1, CORES),
    "center_core.distance_threshold": ("room", 0.005, CORES),
    "center_core.min_length": ("room", 0.02, CORES),
    "center_core.cluster_distance": ("room", 0.5, CORES),
    "objects.min_height": ("room", 0.15, {}),
    "objects.max_height": ("room", 0.1, {}),
    "objects.cluster_distance": ("room", 0.9, {}),
    "objects.min_points": ("room", 100, {}),
    "objects.track_distance": ("room", 0.01, ONE),
    "objects.agreeing_views": ("tracked", 1, {}),
    "objects.place_size": ("surfaces", (0.3, 0.3), {}),
    "lines.extractor": ("walls", "ransac", {}),
    "lines.min_length": ("walls", 2.0, {}),
    "lines.min_points": ("walls", 30, {}),
    "lines.distance": ("walls", 0.01, {}),
    "lines.max_gap": ("walls", 0.1, {}),
    "lines.trials": ("walls", 5, RANSAC),
    "matching.enabled": ("walls", False, {}),
    "matching.range_sigma": ("walls", 0.05, {}),
    "matching.search_angle": ("slipping", 0.6, {}),
    "matching.submap_keyframes": ("walls", 2, {}),
    "matching.correlated_beams": ("walls", 20.0, {}),
    "odometry.sigma_per_m": ("walls", 0.5, {}),
    "odometry.sigma_rad_per_rad": ("walls", 0.5, {}),
    "odometry.sigma_rad_per_m": ("walls", 0.2, {}),
    "odometry.sigma_scale": ("walls", 0.1, {}),
    "walls.enabled": ("walls", False, {}),
    "walls.min_observations": ("walls", 20, {}),
    "walls.gate_distance": ("walls", 0.005, {}),
    "walls.gate_angle": ("walls", 0.4, {"walls.gate_distance": 0.3}),
    "walls.max_gap": ("walls", 20.0, {}),
    "walls.flatness": ("walls", 0.1, {}),
    "walls.discount": ("walls", 20.0, {}),
    "walls.corners": ("walls", "point", {}),
    "walls.thickness": ("walls", 0.001, {}),
    "graph.mode": ("saved walls", "localisation", {}),
    "graph.keyframe_distance": ("walls", 0.9, {}),
    "graph.keyframe_angle": ("walls", 0.1, {}),
    "loops.enabled": ("walls", False, {}),
    "loops.min_path": ("walls", 500.0, {}),
    "loops.max_window": ("walls", 0.05, {}),
    "loops.drift": ("walls", 0.001, {}),
    "loops.drift_angle": ("walls", 0.0001, {}),
    "loops.min_score": ("walls", 0.99, {}),
    "loops.min_inliers": ("walls", 1.0, {}),
    "loops.max_contradiction": ("walls", 0.0, {}),
    "loops.ambiguity": ("walls", 0.05, {}),
    "loops.confirmations": ("walls", 50, {}),
    "views.when": ("driving", "still", {}),
    "views.cell_size": ("room", 0.2, {}),
    "views.reach": ("room", 1.0, {}),
    "views.place_distance": ("surfaces", 0.01, {}),
    "views.place_angle": ("surfaces", 0.01, {}),
    "views.voxel_size": ("surfaces", 0.05, {}),
    "views.clear_margin": ("surfaces", 0.0, {}),
    "surfaces.segmentation": ("room", "seed", {}),
    "surfaces.min_points": ("room", 900, SEED),
    "surfaces.seed_distance": ("room", 0.005, SEED),
    "surfaces.cluster_distance": ("room", 0.02, SEED),
    "surfaces.merge_distance": ("surfaces", 0.3, {}),
    "surfaces.min_height": ("surfaces", 0.2, {}),
    "surfaces.max_step": ("surfaces", 1e-5, {}),
    "surfaces.min_area": ("surfaces", 0.2, {}),
    "surfaces.max_floor_height": ("surfaces", -1.0, {}),
    "surfaces.registration": ("surfaces", False, {}),
    "surfaces.unseen_space": ("seen from", True, {}),
    **{
        f"labels.{rule}": ("labels", NOWHERE, {})
        for rule in (
            "table", "counter", "low_table", "seat", "sofa", "bed", "shelf", "ledge", "step",
            "bench", "sideboard", "side_table",
        )
    },
    "labels.step_height": ("labels", (0.9, 1.0), {}),
    "labels.stair_rise": ("labels", (0.3, 0.4), {}),
    "labels.shelf_gap": ("labels", (2.0, 3.0), {}),
    "labels.back_height": ("labels", (2.0, 3.0), {}),
    "labels.wall_distance": ("labels", 0.01, {}),
    "labels.min_confidence": ("labels", 0.99, {}),
}  # fmt: skip
"""For each parameter: the input, another value, and what else is set in both runs."""


@cache
def result(stage, values):
    """Return the digest of a stage with some parameters set, JSON of {group.key: value}."""
    tree = settings().model_dump() if stage in ("room", "driving", "unsteady") else {}
    for name, value in json.loads(values).items():
        group, key = name.split(".")
        tree.setdefault(group, {})[key] = value
    return STAGES[stage](Config.model_validate(tree))


ON_A_RECORDING = {"matching.search_distance"}
"""Odometry of a simulated drive is never wrong by more than its own model and less than this."""


def test_every_parameter_of_the_algorithms_has_a_case():
    names = {p.name for p in parameters() if p.name.split(".")[0] in GROUPS}
    assert set(CASES) | ON_A_RECORDING == names


def test_the_width_of_the_search_changes_a_recorded_drive(tmp_path):
    log = shared("carmen/mit-csail.clf.bz2")
    import_carmen(log, tmp_path / "bag")
    odometry, scans = {}, []
    with BagReader(tmp_path / "bag") as bag:
        for _, _, item in bag.records({"scan": "/scan", "odom": "/odom"}):
            if isinstance(item, Odometry):
                odometry[item.stamp_ns] = item.T_odom_base[None]
            else:
                scans.append(item)
    poses = []
    for distance in (0.15, 0.001):
        slam = WallSlam(Config.model_validate({"matching": {"search_distance": distance}}))
        for scan in scans[600:750]:
            at = np.array([scan.stamp_ns])
            slam.add_scan(PosedScan(scan, at, odometry[scan.stamp_ns], np.eye(4)[None]))
        poses.append(slam.solve().poses)
    assert np.abs(poses[0] - poses[1]).max() > 1e-3


@pytest.mark.parametrize("name", CASES)
def test_a_parameter_changes_a_result(name):
    stage, value, others = CASES[name]
    before, after = (
        json.dumps(values, sort_keys=True) for values in (others, {**others, name: value})
    )
    assert result(stage, before) != result(stage, after)
