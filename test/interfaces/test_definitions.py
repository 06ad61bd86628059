"""tccm_interfaces as it is defined, documented and generated."""

import importlib
import importlib.util
import json
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

pytest.importorskip("tccm_interfaces", reason="tccm_interfaces is not generated")

ROOT = Path(__file__).resolve().parents[2]
INTERFACES = ROOT / "interfaces"
PUBLIC = ROOT / "tccm_ros" / "ros" / "public_definitions"

UNITS = {"-", "m", "m^2", "rad", "rad/s", "s", "ns", "byte", "m / rad", "rad^2 / rad m / m^2"}

PUBLISHED_HASHES = {
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "vision_msgs/msg/Detection3DArray": (
        "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
    ),
}
"""What nodes of a Jazzy installation say of these types, by `ros2 topic info --verbose`."""


def load_tool(name: str):
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


document = load_tool("document_interfaces")


DEFINITIONS = [
    path for folder, *_ in document.SECTIONS.values() for path in document.definitions(folder)
]


def parts_of(path: Path) -> list:
    return list(document.parts_of(path).values())


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_each_definition_can_be_imported(path):
    module = importlib.import_module(f"tccm_interfaces.{path.parent.name}")
    assert hasattr(module, path.stem)


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_each_definition_states_meaning_and_publisher(path):
    text = document.comment(parts_of(path)[0])
    providers = "Published by", "Returned by", "Service of", "Action of", "Part of"
    assert any(word in text for word in providers), text


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_each_field_has_a_comment_with_its_unit(path):
    for field in (field for part in parts_of(path) for field in part.fields):
        assert document.comment(field), field.name
        unit = field.annotations.get("unit")
        if field.type.pkg_name == document.PACKAGE or field.type.type == "Header":
            assert unit is None, f"{field.name}: the fields of its type have units"
        else:
            assert unit in UNITS, field.name


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_each_pose_point_and_vector_says_in_which_frame_it_is(path):
    for field in (field for part in parts_of(path) for field in part.fields):
        if field.type.pkg_name == "geometry_msgs":
            text = document.comment(field)
            assert "frame" in text or "axes of the pose" in text or "as pose_before" in text, (
                field.name
            )


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_each_constant_has_a_comment_or_a_clear_name(path):
    for part in parts_of(path):
        explained = [c for c in part.constants if document.comment(c)]
        assert len(explained) >= len(part.constants) / 2


@pytest.mark.parametrize("path", sorted(INTERFACES.glob("srv/*")), ids=lambda path: path.stem)
def test_each_answer_begins_with_whether_and_why_not(path):
    response = parts_of(path)[1]
    assert [(f.name, str(f.type)) for f in response.fields[:2]] == [
        ("success", "bool"),
        ("message", "string"),
    ]


def test_a_filter_as_it_is_made_has_no_condition():
    from tccm_interfaces.msg import SurfaceFilter

    made = SurfaceFilter()
    assert (made.min_height, made.max_height) == (-1000.0, 1000.0)
    assert (made.min_area, made.max_distance, made.near.header.frame_id) == (0.0, 0.0, "")
    assert [*made.ids, *made.labels, made.near_sign, made.text] == ["", ""]


def test_the_page_of_the_reference_is_made_from_the_definitions():
    assert document.PAGE.read_text() == document.page(), "run python tools/document_interfaces.py"


def types_by_package() -> dict[str, Path]:
    return {document.PACKAGE: INTERFACES} | {p.name: p for p in PUBLIC.iterdir()}


@pytest.mark.every_distro
def test_generated_types_have_the_hashes_of_their_definitions():
    """The other implementation of type hashes is rosbags'."""
    typestore, types = get_typestore(Stores.ROS2_JAZZY), {}
    for package, folder in types_by_package().items():
        for path in folder.glob("msg/*.msg"):
            types |= get_types_from_msg(path.read_text(), f"{package}/msg/{path.stem}")
    typestore.register(types)
    generated = {name: generated_hash(name) for name in types if is_generated(name)}
    assert len(generated) >= len(list(INTERFACES.glob("msg/*")))
    assert generated == {name: typestore.hash_rihs01(name) for name in generated}


@pytest.mark.parametrize("name", PUBLISHED_HASHES)
def test_generated_types_are_those_of_an_installation(name):
    if not is_generated(name):
        pytest.skip(f"{name} is not generated here")
    assert generated_hash(name) == f"RIHS01_{PUBLISHED_HASHES[name]}"


def is_generated(name: str) -> bool:
    return description_file(name).exists()


def generated_hash(name: str) -> str:
    """Return the type hash that the generators computed."""
    hashes = json.loads(description_file(name).read_text())["type_hashes"]
    return next(entry["hash_string"] for entry in hashes if entry["type_name"] == name)


def description_file(name: str) -> Path:
    return Path(sys.prefix, "share", f"{name}.json")
