"""Rooms at random whose furniture changes, saved for `ablate_views.py`: views, poses and truth.

The map is built after each tilt cycle, as a robot does it, but at the poses that were found once.
"""

from __future__ import annotations

from typing import Any, NamedTuple
from unittest import mock

from bench_changes import judged, slam_inputs
from changing_rooms import solved, told
from random_changes import Piece, in_map, random_rooms

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.scene.changes import MapChanges
from tccm_ros.scene.scene import Scene, known_surface
from tccm_ros.surfaces.objects.object_tracks import track_objects
from tccm_ros.surfaces.objects.scene_objects import scene_objects
from tccm_ros.surfaces.surface_map import SurfaceMap, ViewPoses
from tccm_sim.engine import Simulation
from tccm_sim.options import Options


class Build(NamedTuple):
    """What the map was built from after a tilt cycle.

    Attributes
    ----------
    steps
        Records since the build before, and pairs of stamps between which the base did not move.
    keys
        Views, by session and stamp.
    poses, walls
        Arguments of `SurfaceMap.build`.
    """

    steps: list[Any]
    keys: list[tuple[int, int]]
    poses: ViewPoses
    walls: Float64


class Rooms(NamedTuple):
    """A sequence: its builds, and what happened to its furniture."""

    builds: list[Build]
    pieces: list[Piece]

    def row(self) -> tuple[str, Any]:
        """Return events told, wrong ones, and surfaces of the last map, and everything found."""
        surface_map, scenes = SurfaceMap(Config()), []
        for build in self.builds:
            for step in build.steps:
                if isinstance(step, dict):
                    surface_map.forget(lambda *pair, still=step: still.get(pair, False))
                else:
                    surface_map.add(step)
            scenes.append(_scene(surface_map, build))
        found = [e for e in told(iter(scenes), MapChanges()) if e.object_id < 0]
        untold, wrong = judged(found, self.pieces)
        count = sum(len(piece.kinds) for piece in self.pieces)
        text = f"{count - len(untold)} {len(wrong)} {len(scenes[-1].surfaces)}"
        return text, [list(found), [[*s.surfaces, *s.objects] for s in scenes]]


def _scene(surface_map: SurfaceMap, build: Build) -> Scene:
    """Return the scene of a build; KeyError if other views are kept than were."""
    views = surface_map.views
    if [view.key for view in views] != build.keys:
        raise KeyError
    mapped = surface_map.build(build.poses, build.walls)
    tracks = track_objects(views, build.poses.T_map_view, Config()).tracks
    objects = scene_objects(mapped.surfaces, tracks)
    previous, newest = sorted([0, 0, *(view.stamp_ns for view in views)])[-2:]
    surfaces = tuple(known_surface(surface) for surface in mapped.surfaces)
    return Scene(newest, "map", mapped.floor_z, objects, None, surfaces, newest, previous)


def record(seed: int) -> Rooms:
    """Return the sequence of a seed."""
    world, furniture = random_rooms(seed, Options())
    simulation = Simulation(world, seed, Options())
    inputs, pieces = slam_inputs(simulation), in_map(furniture, simulation)
    builds: list[Build] = []
    steps: list[Any] = []
    add, forget, build = SurfaceMap.add, SurfaceMap.forget, SurfaceMap.build

    def kept_add(surface_map: SurfaceMap, record: Any) -> None:
        steps.append(record)
        add(surface_map, record)

    def kept_forget(surface_map: SurfaceMap, is_stationary: Any) -> None:
        still: dict[tuple[int, int], bool] = {}

        def noted(first_ns: int, last_ns: int) -> bool:
            still[first_ns, last_ns] = is_stationary(first_ns, last_ns)
            return still[first_ns, last_ns]

        forget(surface_map, noted)
        steps.append(still)

    def kept_build(surface_map: SurfaceMap, poses: ViewPoses, walls: Float64) -> Any:
        keys = [view.key for view in surface_map.views]
        builds.append(Build(list(steps), keys, poses, walls))
        steps.clear()
        return build(surface_map, poses, walls)

    with (
        mock.patch.object(SurfaceMap, "add", kept_add),
        mock.patch.object(SurfaceMap, "forget", kept_forget),
        mock.patch.object(SurfaceMap, "build", kept_build),
    ):
        for _ in solved(inputs, SurfaceSlam(Config())):
            pass
    return Rooms(builds, pieces)
