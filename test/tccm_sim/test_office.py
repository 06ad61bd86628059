"""The office: its door signs are where its truth says, can be read, and name its rooms."""

import io
from importlib.util import find_spec

import numpy as np
import pytest
from PIL import Image
from shapely import Point, Polygon

from tccm_ros.records import CameraImage, CameraInfo
from tccm_sim.colour_camera import ColourRenderer, exposed
from tccm_sim.door_plates import STYLES, door_plate
from tccm_sim.engine import Simulation
from tccm_sim.office import (
    doors,
    office_panels,
    office_rooms,
    office_scene,
    office_signs,
)
from tccm_sim.options import Options
from tccm_sim.panels import panel_arrays
from tccm_sim.truth import map_from_world, surfaces
from tccm_sim.worlds import build_world

needs_reader = pytest.mark.skipif(
    find_spec("rapidocr_onnxruntime") is None, reason="the extra signs is not installed"
)


@pytest.fixture(scope="module")
def simulation():
    return Simulation(build_world("office_signs"), 1)


def test_each_of_ten_rooms_has_one_sign_beside_its_door_on_the_corridor():
    signs = [panel for panel in office_panels() if panel.number]
    assert [sign.number for sign in signs] == [str(n) for n in range(201, 211)]
    rooms = {room.name: Polygon(room.boundary) for room in office_rooms()}
    assert len(rooms) == 11
    for sign, door in zip(signs, doors(), strict=True):
        assert door.number == sign.number
        assert 0.45 < abs(sign.position[0] - door.x) < 0.9
        before = sign.position + 0.1 * sign.normal
        behind = sign.position - 0.3 * sign.normal
        assert rooms["corridor"].contains(Point(before[:2]))
        assert rooms[sign.number].contains(Point(behind[:2]))


def test_nothing_hangs_over_a_door_or_over_something_else():
    panels = office_panels()
    spans = [
        (np.sign(p.position[1]), p.T_world_panel[0, 3] - p.width / 2,
         p.T_world_panel[0, 3] + p.width / 2)
        for p in panels
    ]  # fmt: skip
    gaps = [(door.side, door.x - 0.45, door.x + 0.45) for door in doors()]
    for k, (side, low, high) in enumerate(spans):
        for other_side, a, b in spans[:k] + gaps:
            assert side != other_side or high < a or b < low


def test_identical_rooms_differ_in_their_pose_alone():
    def shapes(alike):
        solids = office_scene(alike=alike).solids
        found = {}
        for door in doors():
            y = door.side * 1.12
            own = [
                (s.name.split(" of ")[0], *np.round(door.side * (s.T_world_solid[0, 3] - door.x), 6)
                 [None], *np.round(door.side * (s.T_world_solid[1, 3] - y), 6)[None],
                 round(float(s.T_world_solid[2, 3]), 6))
                for s in solids
                if s.role == "furniture" and abs(s.T_world_solid[0, 3] - door.x) < 2.2
                and door.side * s.T_world_solid[1, 3] > 1.0
                and 0.0 < door.side * (s.T_world_solid[0, 3] - door.x) + 1.0 < 3.2
            ]  # fmt: skip
            found[door.number] = sorted(own)
        return list(found.values())

    alike, varied = shapes(True), shapes(False)
    assert all(len(own) == 12 for own in alike)
    assert all(own == alike[0] for own in alike)
    assert varied[0] != varied[2]


def test_truth_has_signs_and_rooms_in_the_map_frame(simulation):
    truth = surfaces(simulation)
    T = map_from_world(simulation)
    assert len(truth["signs"]) == 10
    assert len(truth["rooms"]) == 11
    panels = {panel.number: panel for panel in office_panels()}
    for sign in truth["signs"]:
        expected = T @ [*panels[sign["text"]].position, 1.0]
        assert sign["position"] == pytest.approx(expected[:3].tolist(), abs=1e-6)
        assert sign["room"] == sign["text"]
    area = sum(Polygon(room["boundary"]).area for room in truth["rooms"])
    assert area == pytest.approx(sum(Polygon(r.boundary).area for r in office_rooms()), abs=1e-4)


def picture_of(simulation, number, *, distance=1.0, angle=0.5, style=0):
    """Return a picture of a plate from a distance, at an angle to its normal."""
    panels = office_panels(style)
    sign = next(panel for panel in panels if panel.number == number)
    away = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                     [0, 0, 1]]) @ sign.normal  # fmt: skip
    T = np.eye(4)
    T[:3, :3] = np.column_stack([np.cross(-away, (0, 0, 1)), (0, 0, -1), -away])
    T[:3, 3] = sign.position + distance * away - [0.0, 0.0, 0.1]
    camera = simulation.rig.colour_camera
    renderer = ColourRenderer(simulation.scene, panel_arrays(panels))
    poses = np.repeat(T[None], 4, axis=0)
    pixels = exposed(camera, renderer.render(camera, poses, 0.0), np.random.default_rng(3))
    q = np.linalg.inv(T) @ [*sign.position, 1.0]
    return pixels, camera.focal * q[:2] / q[2] + np.array(camera.center)


@needs_reader
@pytest.mark.parametrize("style", range(len(STYLES)))
def test_plates_of_every_style_can_be_read_where_they_are(simulation, style):
    from tccm_ros.signs.detector import SignDetector

    detector = SignDetector()
    for number in ("203", "206"):
        pixels, expected = picture_of(simulation, number, style=style)
        found = detector.detect(pixels)
        assert [sign.number for sign in found] == [number]
        assert found[0].pixel - 0.5 == pytest.approx(expected, abs=2.5)


def test_plates_differ_with_their_style_and_text():
    plates = [door_plate("204", "Archive", style).pixels for style in STYLES]
    assert len({plate.tobytes() for plate in plates}) == len(STYLES)
    other = door_plate("205", "Archive", STYLES[0]).pixels
    assert 0.005 < (other != plates[0]).mean() < 0.2


def test_the_bag_has_pictures_and_calibrations_that_belong_together(simulation):
    images, infos = [], []
    for message in simulation.run():
        record = message.records[0]
        if isinstance(record, CameraImage):
            images.append(record)
        elif isinstance(record, CameraInfo):
            infos.append(record)
        if len(images) == 3:
            break
    for image, info in zip(images, infos):
        assert image.stamp_ns == info.stamp_ns
        assert image.size == info.image_size
        assert image.frame_id == info.frame_id == "camera_optical"
        with Image.open(io.BytesIO(image.data.tobytes())) as file:
            assert file.format == "JPEG"
            assert file.size == image.size
    assert images[1].stamp_ns - images[0].stamp_ns == 500_000_000


def test_two_laps_pass_every_sign_twice():
    world = office_signs(Options(laps=2))
    x = world.drive.columns[0]
    assert np.count_nonzero(np.diff(np.sign(x - 8.0))) == 4
