"""Read a robot description: links, joints and collision shapes.

The text is untrusted: no entities of its own; a size limit; finite numbers only. As in ROS's own
parser (tinyxml2), these are tolerated: whitespace before the declaration, two hyphens in a comment,
undeclared prefixes, a bare ampersand, "<" in an attribute. A fault of one joint is stored with it
and matters only if a chain needs that joint. Meshes are listed, not loaded.
"""

import re
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import UrdfError, one_line, suggest
from tccm_ros.geometry import pose_from_rpy

MAX_URDF_BYTES = 8_000_000
"""Maximum size of a robot description, bytes. Chosen: large real ones have some 200 kB."""

#: Motion of movable joint types.
MOVING = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}


@dataclass(frozen=True, slots=True)
class Mimic:
    """A mimic joint: position = multiplier * other + offset.

    Attributes
    ----------
    joint
        Name of the other joint.
    multiplier, offset
        Coefficients of the equation; the offset in rad or m.
    """

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint: T_parent_child(q) = T_parent_joint * motion(q).

    Attributes
    ----------
    motion
        ``fixed``, ``turn`` (rad, about the axis) or ``slide`` (m, along it); ``loose`` for floating
        and planar joints, whose position joint states do not give.
    T_parent_joint
        float64 (4, 4), origin of the joint.
    axis
        Unit vector float64 (3,) in the joint's frame.
    limits
        Lower and upper limit, rad or m; None for none.
    fault
        Description of an invalid joint, which no chain can use; empty for a valid one.
    """

    name: str
    motion: str
    parent: str
    child: str
    T_parent_joint: Float64
    axis: Float64
    mimic: Mimic | None
    limits: tuple[float, float] | None = None
    fault: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionShape:
    """A collision shape of a link.

    Attributes
    ----------
    kind
        ``box``, ``sphere`` or ``cylinder`` (along its z).
    size
        float64 (3,), half extents of the bounding box: sphere (r, r, r), cylinder (r, r, length /
        2).
    """

    link: str
    kind: str
    size: Float64
    T_link_shape: Float64


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """A robot: a tree of links.

    Attributes
    ----------
    joints
        Joints by the name of the child link.
    shapes
        Collision shapes, without meshes, which are not loaded.
    faults
        Descriptions of invalid joints and shapes, one line each; invalid shapes are left out.
    """

    name: str
    root: str
    links: tuple[str, ...]
    joints: dict[str, Joint]
    shapes: tuple[CollisionShape, ...]
    faults: tuple[str, ...] = ()


_DECLARATION = re.compile(r"\A<\?xml\b.*?\?>", re.DOTALL)
_COMMENT_OR_DATA = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>", re.DOTALL)
_BARE_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);)")
_ATTRIBUTE = re.compile(r"""=\s*(?:"[^"]*"|'[^']*')""")


def _parse(text: str) -> ElementTree.Element:
    """Return the root element of XML with the tolerance of tinyxml2; prefixes stay in names.

    Raises
    ------
    UrdfError
        For declarations of entities, before any is read, and for text that is not XML.
    """
    text = _DECLARATION.sub("", text.lstrip("\ufeff \t\r\n"))
    parts, end = [], 0
    for found in _COMMENT_OR_DATA.finditer(text):
        data = "" if found.group().startswith("<!--") else found.group()
        parts += [_escaped(text[end : found.start()]), data]
        end = found.end()
    parts.append(_escaped(text[end:]))
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate("utf-8")
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.StartDoctypeDeclHandler = _refuse_declarations
    try:
        parser.Parse("".join(parts).encode("utf-8", "replace"), True)
        return builder.close()
    except (expat.ExpatError, ValueError, AssertionError) as error:
        raise UrdfError(f"robot description: not XML ({one_line(error, limit=80)})") from None


def _escaped(text: str) -> str:
    """Return XML with its bare ampersands, and "<" in its attributes, escaped."""
    text = _ATTRIBUTE.sub(lambda found: found.group().replace("<", "&lt;"), text)
    return _BARE_AMPERSAND.sub("&amp;", text)


def _refuse_declarations(_: str, system: str | None, public: str | None, has_subset: int) -> None:
    if has_subset or system or public:
        raise UrdfError("robot description: a document type is not allowed; remove <!DOCTYPE")


def read_urdf(text: str) -> RobotModel:
    """Read a robot description.

    Raises
    ------
    UrdfError
        For text that is not a URDF, declares entities, is too large, names unknown links or is
        not one tree. Faults of single joints and shapes are in `RobotModel.faults`.
    """
    size = len(text.encode("utf-8", "replace"))
    if size > MAX_URDF_BYTES:
        raise UrdfError(f"robot description: {size} bytes, at most {MAX_URDF_BYTES} are read")
    if not text.strip():
        raise UrdfError("robot description: empty")
    root = _parse(text)
    if root.tag != "robot":
        raise UrdfError(f"robot description: <robot> is expected, found <{root.tag[:40]}>")
    links = _links(root)
    joints = _joints(root, set(links))
    shapes, faults = _shapes(root)
    faults = [*(joint.fault for joint in joints.values() if joint.fault), *faults]
    name = root.get("name", "")
    return RobotModel(name, _root_link(links, joints), links, joints, shapes, tuple(faults))


def _links(root: ElementTree.Element) -> tuple[str, ...]:
    names = [_name(link, "link") for link in root.findall("link")]
    if not names:
        raise UrdfError("robot description: it has no links")
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise UrdfError(f"robot description: link '{name}' is there twice")
        seen.add(name)
    return tuple(names)


def _name(element: ElementTree.Element, what: str) -> str:
    name = element.get("name", "")
    if not name:
        raise UrdfError(f"robot description: a {what} without a name")
    return name


def _joints(root: ElementTree.Element, links: set[str]) -> dict[str, Joint]:
    joints: dict[str, Joint] = {}
    names: set[str] = set()
    for element in root.findall("joint"):
        joint = _joint(element)
        for end in (joint.parent, joint.child):
            if end not in links:
                raise UrdfError(
                    f"robot description: joint '{joint.name}' names no link '{end}'"
                    + suggest(end, links)
                )
        if joint.name in names:
            raise UrdfError(f"robot description: joint '{joint.name}' is there twice")
        if joint.child in joints:
            raise UrdfError(f"robot description: link '{joint.child}' has two parents")
        names.add(joint.name)
        joints[joint.child] = joint
    for child, joint in joints.items():
        if joint.mimic is not None and joint.mimic.joint not in names and not joint.fault:
            fault = f"joint '{joint.name}' mimics no joint '{joint.mimic.joint}'"
            joints[child] = replace(joint, fault=fault + suggest(joint.mimic.joint, names))
    return joints


def _joint(element: ElementTree.Element) -> Joint:
    """Return a joint; one with a fault is ``loose`` and has the identity as origin."""
    name = _name(element, "joint")
    ends = [element.find(end) for end in ("parent", "child")]
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    try:
        return _movement(
            element, Joint(name, "fixed", parent, child, np.eye(4), np.eye(3)[0], None)
        )
    except UrdfError as error:
        fault = str(error).removeprefix("robot description: ")
        return Joint(name, "loose", parent, child, np.eye(4), np.eye(3)[0], None, fault=fault)


def _movement(element: ElementTree.Element, joint: Joint) -> Joint:
    """Return a joint with its origin, axis and limits."""
    where = f"joint '{joint.name}'"
    kind = element.get("type", "")
    if kind not in (*MOVING, "fixed", "floating", "planar"):
        raise UrdfError(f"robot description: {where} has the unknown type '{kind}'")
    axis = joint.axis
    found = element.find("axis")
    if found is not None and kind in MOVING:
        axis = _numbers(found.get("xyz", "1 0 0"), 3, f"{where} axis")
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise UrdfError(f"robot description: {where} has an axis of zero length")
    return replace(
        joint,
        motion=MOVING.get(kind, "fixed" if kind == "fixed" else "loose"),
        T_parent_joint=_origin(element, where),
        axis=axis / length,
        mimic=_mimic(element, where),
        limits=_limits(element, kind),
    )


def _limits(element: ElementTree.Element, kind: str) -> tuple[float, float] | None:
    """Return the limits of a joint; None if they are missing or leave no range."""
    found = element.find("limit")
    if found is None or kind not in ("revolute", "prismatic"):
        return None
    try:
        low, high = (float(found.get(end, "0")) for end in ("lower", "upper"))
    except ValueError:
        return None
    return (low, high) if -np.inf < low < high < np.inf else None


def _mimic(element: ElementTree.Element, where: str) -> Mimic | None:
    found = element.find("mimic")
    if found is None:
        return None
    return Mimic(
        found.get("joint", ""),
        float(_numbers(found.get("multiplier", "1"), 1, f"{where} mimic")[0]),
        float(_numbers(found.get("offset", "0"), 1, f"{where} mimic")[0]),
    )


def _origin(element: ElementTree.Element, where: str) -> Float64:
    found = element.find("origin")
    if found is None:
        return np.eye(4)
    xyz = _numbers(found.get("xyz", "0 0 0"), 3, f"{where} origin")
    rpy = _numbers(found.get("rpy", "0 0 0"), 3, f"{where} origin")
    return pose_from_rpy(np.concatenate([xyz, rpy]))


def _numbers(text: str, count: int, where: str) -> Float64:
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise UrdfError(
            f"robot description: {where}: {count} numbers expected, found '{text[:40]}'"
        )
    return values


def _root_link(links: tuple[str, ...], joints: dict[str, Joint]) -> str:
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        raise UrdfError(
            "robot description: its links are not one tree; "
            + (f"roots: {', '.join(sorted(roots)[:8])}" if roots else "they form a ring")
        )
    placed = {roots[0]}
    for link in links:
        trail: list[str] = []
        on_trail: set[str] = set()
        while link not in placed:
            if link in on_trail:
                raise UrdfError(f"robot description: the joints at link '{link}' form a ring")
            trail.append(link)
            on_trail.add(link)
            link = joints[link].parent
        placed.update(trail)
    return roots[0]


def _shapes(root: ElementTree.Element) -> tuple[tuple[CollisionShape, ...], list[str]]:
    """Return the shapes but for meshes, and descriptions of invalid shapes left out."""
    shapes: list[CollisionShape] = []
    faults: list[str] = []
    for link in root.findall("link"):
        name = link.get("name", "")
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            found: Any = None if geometry is None else next(iter(geometry), None)
            if found is None or found.tag not in ("box", "sphere", "cylinder"):
                continue
            where = f"collision of link '{name}'"
            try:
                size, T_link_shape = _half_extents(found, where), _origin(collision, where)
            except UrdfError as error:
                faults.append(str(error).removeprefix("robot description: "))
            else:
                shapes.append(CollisionShape(name, found.tag, size, T_link_shape))
    return tuple(shapes), faults


def _half_extents(element: ElementTree.Element, where: str) -> Float64:
    if element.tag == "box":
        half = _numbers(element.get("size", ""), 3, where) / 2.0
    else:
        radius = _numbers(element.get("radius", ""), 1, where)[0]
        half = np.full(3, radius)
        if element.tag == "cylinder":
            half[2] = _numbers(element.get("length", ""), 1, where)[0] / 2.0
    if (half < 0.0).any():
        raise UrdfError(f"robot description: {where}: a negative size")
    return half
