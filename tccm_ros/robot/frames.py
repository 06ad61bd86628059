"""The tree of frames from the robot description and tf, and paths through it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import FrameError, suggest
from tccm_ros.geometry import inverse
from tccm_ros.records import TransformSample
from tccm_ros.robot.chain import JointReading, MovingTransform, Part, TransformChain
from tccm_ros.robot.tracks import PoseTrack
from tccm_ros.robot.urdf import Joint, RobotModel, read_urdf

MAX_FRAMES = 4096
"""Maximum number of frames; further ones are refused. Chosen: more than any robot has."""


@dataclass(slots=True, eq=False)
class TfEdge:
    """A tf transform, static or moving.

    Attributes
    ----------
    parent, child
        The two frames.
    T_parent_child
        float64 (4, 4) if it is static; None otherwise.
    track
        Samples of /tf; a transform of /tf may be constant.
    """

    parent: str
    child: str
    T_parent_child: Float64 | None
    track: PoseTrack


#: Edges by child frame.
Edges = dict[str, Joint | TfEdge]


class FrameTree:
    """Frames by child name. The robot description takes precedence over tf.

    Attributes
    ----------
    model
        The robot description; None before it arrives.
    tf
        The tf transforms by child frame.
    odometry_child
        The child frame of odometry; None before odometry arrives.
    version
        Incremented when chains must be found again.
    """

    def __init__(self) -> None:
        self.model: RobotModel | None = None
        self.tf: dict[str, TfEdge] = {}
        self.odometry_child: str | None = None
        self.version = 0
        self._urdf: str | None = None

    def describe(self, urdf: str) -> None:
        """Replace the robot description.

        Raises
        ------
        UrdfError
            If it cannot be read; the previous one remains.
        """
        if urdf != self._urdf:
            self.model = read_urdf(urdf)
            self._urdf = urdf
            self.version += 1

    def follow_odometry(self, child: str) -> None:
        """Set the child frame of odometry; only the first call has an effect."""
        if self.odometry_child is None:
            self.odometry_child = child
            self.version += 1

    def find_anew(self) -> None:
        """Invalidate all chains, as the base may have changed."""
        self.version += 1

    def add_transform(self, sample: TransformSample) -> bool:
        """Add a tf transform; return whether it was used.

        The first parent of a frame is kept, and samples must be newer than the previous one.
        """
        edge = self._edge(sample.parent, sample.child)
        if edge is None:
            return False
        if not sample.is_static:
            had_moved = edge.track.has_moved
            is_newer = edge.track.append_pose(sample.stamp_ns, sample.T_parent_child)
            self.version += edge.track.has_moved != had_moved
            return is_newer
        if edge.T_parent_child is None or not np.array_equal(
            edge.T_parent_child, sample.T_parent_child
        ):
            edge.T_parent_child = sample.T_parent_child
            self.version += 1
        return True

    def note_transform(self, sample: TransformSample) -> None:
        """Note the first /tf transform of a frame, whatever its stamp.

        A constant transform is valid at any time: drivers publish it rarely, late or once.
        """
        if sample.child not in self.tf:
            edge = self._edge(sample.parent, sample.child)
            if edge is not None:
                edge.track.note(sample.T_parent_child)

    def _edge(self, parent: str, child: str) -> TfEdge | None:
        """Return the edge to a child; None if the child has another parent."""
        edge = self.tf.get(child)
        if edge is None:
            if len(self.tf) >= MAX_FRAMES or parent == child:
                return None
            edge = self.tf[child] = TfEdge(parent, child, None, PoseTrack())
            self.version += 1
        return edge if edge.parent == parent else None

    def clear_samples(self) -> None:
        """Clear moving transforms; static ones remain."""
        for child in [c for c, edge in self.tf.items() if edge.T_parent_child is None]:
            del self.tf[child]
        self.version += 1

    def view(self, *, urdf: bool = True, moving_tf: bool = True) -> Edges:
        """Return the edges of tf and of the selected sources, by child frame.

        Parameters
        ----------
        urdf
            Whether to include joints of the robot description; they take precedence over tf.
        moving_tf
            Whether to include moving tf transforms, not only static ones.
        """
        edges: Edges = {
            child: edge
            for child, edge in self.tf.items()
            if moving_tf or edge.T_parent_child is not None
        }
        if urdf and self.model is not None:
            edges.update(self.model.joints)
        return edges


def frames_of(edges: Edges) -> set[str]:
    """Return the names of all frames of a tree."""
    return set(edges) | {edge.parent for edge in edges.values()}


def ancestors(frame: str, edges: Edges) -> list[str]:
    """Return a frame and its ancestors up to the root; a cycle ends at its first repeated frame."""
    line = [frame]
    seen = {frame}
    while line[-1] in edges:
        parent = edges[line[-1]].parent
        if parent in seen:
            break
        seen.add(parent)
        line.append(parent)
    return line


def find_path(a: str, b: str, edges: Edges) -> list[tuple[Joint | TfEdge, bool]]:
    """Return the edges from frame a to frame b, each with True if it is traversed backwards.

    Parameters
    ----------
    a, b
        Frames.
    edges
        One tree or several, by child frame.

    Raises
    ------
    FrameError
        Where there is no path; the message names the frames.
    """
    up, down = ancestors(a, edges), ancestors(b, edges)
    shared = next((frame for frame in up if frame in set(down)), None)
    if shared is None:
        known = frames_of(edges)
        missing = [frame for frame in (a, b) if frame not in known]
        raise FrameError(
            f"no way from base '{a}' to sensor '{b}'"
            + (
                f": no frame '{missing[0]}'" + suggest(missing[0], known)
                if missing
                else ": they are in separate trees; publish the transform that joins them"
            )
        )
    there = [(edges[frame], True) for frame in up[: up.index(shared)]]
    back = [(edges[frame], False) for frame in down[: down.index(shared)]]
    return there + back[::-1]


def no_reading(joint: Joint) -> JointReading:
    """Raise FrameError: the chain must not depend on samples of a joint."""
    raise FrameError(f"joint '{joint.name}' moves, and its position is not known here")


def build_chain(
    path: list[tuple[Joint | TfEdge, bool]], reading: Callable[[Joint], JointReading] = no_reading
) -> TransformChain:
    """Return the chain of a path; `reading` gives the samples of a joint.

    Raises
    ------
    FrameError
        For a floating or planar joint, and without `reading` for any moving joint.
    """
    fixed, parts = [np.eye(4)], []
    for edge, backwards in path:
        for before, part, after in _links(edge, backwards, reading):
            fixed[-1] = fixed[-1] @ before
            if part is not None:
                parts.append((part, backwards))
                fixed.append(after)
    return TransformChain(np.array(fixed), tuple(parts))


def _links(
    edge: Joint | TfEdge, backwards: bool, reading: Callable[[Joint], JointReading]
) -> Iterator[tuple[Float64, Part | None, Float64]]:
    one = np.eye(4)
    if isinstance(edge, TfEdge):
        if edge.T_parent_child is None:
            yield one, MovingTransform(edge.child, edge.track), one
        else:
            yield inverse(edge.T_parent_child) if backwards else edge.T_parent_child, None, one
        return
    if edge.fault:
        raise FrameError(edge.fault)
    origin = inverse(edge.T_parent_joint) if backwards else edge.T_parent_joint
    if edge.motion == "fixed":
        yield origin, None, one
    elif edge.motion == "loose":
        raise FrameError(f"joint '{edge.name}' between base and laser is floating or planar")
    elif backwards:
        yield one, reading(edge), origin
    else:
        yield origin, reading(edge), one
