"""Objects between solutions: the tracks of the newest solution, continued by newer views.

The solver process answers nothing meanwhile, so this runs elsewhere. A view takes the same
time at any length of the drive: views of the solution are not looked at again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import compose2, spatial
from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals
from tccm_ros.scene.scene import Scene
from tccm_ros.slam.base_attitude import interpolate
from tccm_ros.surfaces.objects.object_tracks import NO_OBJECTS, track_objects
from tccm_ros.surfaces.objects.scene_objects import scene_objects
from tccm_ros.surfaces.views.views import View, empty_view, with_intervals, with_objects

POSES = 500
"""Number of live poses among which is that of a view. Chosen: 12 s of a 40 Hz laser; a view arrives
within a second."""


@dataclass(slots=True, eq=False)
class _NewView:
    """A view that is in no solution yet, without patches, which come with the next one.

    Attributes
    ----------
    pose
        Planar pose (3,) of its base in map.
    view
        Made of the parts that have come; the points of its cloud are not kept.
    parts
        Types of these parts.
    """

    pose: Float64
    view: View
    parts: set[type] = field(default_factory=set)

    @property
    def is_whole(self) -> bool:
        return len(self.parts) == 3

    def add(self, part: SurfaceCloud | ViewIntervals | ObjectBoxes) -> None:
        """Add a part."""
        self.parts.add(type(part))
        if isinstance(part, ViewIntervals):
            self.view = with_intervals(self.view, part)
        elif isinstance(part, ObjectBoxes):
            self.view = with_objects(self.view, part)
        elif part.viewpoint is not None:
            eye = part.viewpoint.astype(np.float64)
            self.view = replace(self.view, viewpoint=eye, sensor=part.sensor)


class LiveObjects:
    """The objects after all views, on the surfaces of the newest solution.

    Parameters
    ----------
    config
        Groups `views`, `objects`, `sensors` and `map`.
    """

    def __init__(self, config: Config):
        self._config = config
        self.forget()

    def forget(self) -> None:
        """Begin another map."""
        self._poses: deque[tuple[int, Float64]] = deque(maxlen=POSES)
        self._views: dict[int, _NewView] = {}
        self._scene: Scene | None = None
        self._restart()

    def drop_views(self) -> None:
        """Return to the objects of the solution: the live pose is not in its map any more."""
        self._poses.clear()
        self._views.clear()
        self._restart()

    def _restart(self) -> None:
        """Track the views that are in no solution yet again, from the tracks of the solution."""
        scene = self._scene
        self._tracked = NO_OBJECTS if scene is None else scene.tracked
        self._tracked_ns = 0 if scene is None else scene.newest_view_ns

    def add_pose(self, stamp_ns: int, pose: Float64) -> None:
        """Add the live pose (3,) of the base in map; stamps increase."""
        self._poses.append((stamp_ns, pose))

    def correct(self, p_after_before: Float64) -> None:
        """Move the live poses before a correction: its planar pose (3,) times each of them."""
        poses = [(ns, compose2(p_after_before, pose)) for ns, pose in self._poses]
        self._poses = deque(poses, maxlen=POSES)
        for new in self._views.values():
            new.pose = compose2(p_after_before, new.pose)
        self._restart()

    def add(self, part: SurfaceCloud | ViewIntervals | ObjectBoxes) -> bool:
        """Add a part of a view; return whether it completes a view that is in no solution yet.

        Views before the first live pose are not used.
        """
        stamp_ns = part.stamp_ns
        is_solved = self._scene is not None and stamp_ns <= self._scene.newest_view_ns
        if is_solved or not self._poses:
            return False
        if stamp_ns not in self._views:
            view = empty_view(stamp_ns, 0, self._config)
            self._views[stamp_ns] = _NewView(self._pose_at(stamp_ns), view)
        new = self._views[stamp_ns]
        new.add(part)
        return new.is_whole and stamp_ns > self._tracked_ns

    def _pose_at(self, stamp_ns: int) -> Float64:
        stamps = np.array([ns for ns, _ in self._poses], np.int64)
        poses = np.stack([pose for _, pose in self._poses])
        poses[:, 2] = np.unwrap(poses[:, 2])
        return interpolate(stamps, poses, [stamp_ns])[0]

    def take(self, scene: Scene) -> Scene:
        """Continue from the scene of a solution; return it after the newest view."""
        self._scene = scene
        self._restart()
        self._views = {ns: new for ns, new in self._views.items() if ns > self._tracked_ns}
        return self._after_views(scene)._replace(stamp_ns=scene.stamp_ns)

    def scene(self) -> Scene | None:
        """Return the scene after the newest view, with its stamp; None before a solution."""
        return None if self._scene is None else self._after_views(self._scene)

    def _after_views(self, scene: Scene) -> Scene:
        """Return a scene after all whole views, with the newest of their stamps."""
        newer = sorted(ns for ns, v in self._views.items() if v.is_whole and ns > self._tracked_ns)
        if newer:
            views = [self._views[ns].view for ns in newer]
            T_map_view = np.stack([spatial(self._views[ns].pose) for ns in newer])
            self._tracked = track_objects(views, T_map_view, self._config, self._tracked)
            self._tracked_ns = newer[-1]
        if self._tracked is scene.tracked:
            return scene
        surfaces = [known.surface for known in scene.surfaces]
        objects = scene_objects(surfaces, self._tracked.tracks)
        return scene._replace(objects=objects, stamp_ns=self._tracked_ns)
