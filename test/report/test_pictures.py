"""map.png and map3d.png: repeatable, without metadata, with the content of the map."""

import io
import shutil
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from PIL import Image

from tccm_ros.errors import OutputError
from tccm_ros.report import palette
from tccm_ros.report.label_layout import LabelRequest, label_point, place_labels
from tccm_ros.report.map3d_picture import view_camera
from tccm_ros.report.map_picture import map_png
from tccm_ros.report.pictures import draw_pictures, write_pictures
from tccm_ros.results.folder_reader import load_results


def chunks(data):
    at, kinds = 8, []
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kinds.append(data[at + 4 : at + 8])
        at += 12 + length
    return kinds


@pytest.fixture(scope="module")
def pictures(flat):
    write_pictures(load_results(flat), flat)
    return flat / "map.png", flat / "map3d.png"


def test_pictures_have_the_same_bytes_each_time_and_no_metadata(flat, pictures):
    before = [path.read_bytes() for path in pictures]
    assert list(draw_pictures(load_results(flat))) == before
    for data in before:
        assert set(chunks(data)) <= {b"IHDR", b"PLTE", b"IDAT", b"IEND"}


def test_the_users_matplotlib_settings_have_no_effect(flat, pictures, monkeypatch):
    import matplotlib

    before = pictures[0].read_bytes()
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "text.color": "red"}):
        assert draw_pictures(load_results(flat)).above == before


def test_pictures_have_the_size_for_the_readme(pictures):
    for path in pictures:
        width, height = Image.open(path).size
        assert width == 1800
        assert 600 <= height <= 2600


def test_every_surface_is_drawn_in_its_colour(flat, pictures):
    results = load_results(flat)
    colors = palette.surface_colors(results.surfaces)
    shown = np.asarray(Image.open(pictures[0]).convert("RGB")).reshape(-1, 3)
    kinds, counts = np.unique(shown, axis=0, return_counts=True)
    for surface in results.above_floor:
        outline = np.array(to_rgb(colors[surface.id])) * 255
        # The two lower boards lie under the upper one; their leaders show their colour, which
        # a palette of 256 keeps to a few steps in a hundred.
        near = np.abs(kinds - outline).max(axis=1) <= 40
        assert counts[near].sum() > 50, (surface.id, surface.label)


def test_neighbouring_surfaces_have_different_colours(flat):
    colors = palette.surface_colors(load_results(flat).surfaces)
    standing = [c for c in colors.values() if c != palette.FLOOR]
    assert len(set(standing)) == len(standing)


def test_colours_do_not_depend_on_the_order_of_surfaces(flat):
    surfaces = load_results(flat).surfaces
    assert palette.surface_colors(surfaces) == palette.surface_colors(surfaces[::-1])


def test_true_outlines_are_drawn(flat_copy, pictures):
    shutil.copy(flat_copy / "surfaces.json", flat_copy / "truth.json")
    assert map_png(load_results(flat_copy)) != pictures[0].read_bytes()


@pytest.mark.parametrize("keep", ["nothing", "walls", "surfaces"])
def test_a_map_with_some_files_alone_is_drawn(flat_copy, keep):
    if keep != "surfaces":
        (flat_copy / "surfaces.json").write_text('{"floor_z": null, "surfaces": []}')
    if keep != "walls":
        (flat_copy / "walls.json").write_text('{"walls": []}')
    (flat_copy / "trajectory.tum").write_text("")
    for content in draw_pictures(load_results(flat_copy)):
        assert Image.open(io.BytesIO(content)).size[0] == 1800


def test_a_path_that_cannot_be_written_is_an_error(flat, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"map\.png: cannot be written"):
        write_pictures(load_results(flat), tmp_path / "file")


def test_the_camera_keeps_left_and_up_in_the_picture(flat):
    camera = view_camera(load_results(flat))
    west, east, up = camera.project(np.array([[0.0, 0, 0], [7.0, 0, 0], [0.0, 0, 1.0]]))
    assert west[0] < east[0]
    assert up[1] > west[1]
    assert up[0] == pytest.approx(west[0], abs=0.02)


PLACES = st.lists(st.tuples(st.floats(0, 400), st.floats(0, 400)), min_size=1, max_size=14)


@settings(max_examples=40, deadline=None)
@given(PLACES)
def test_labels_do_not_overlap_while_there_is_room(places):
    size = np.array([60.0, 24.0])
    requests = [LabelRequest(np.array(p), size) for p in places]
    area = np.array([[-200.0, -200.0], [600.0, 600.0]])
    centers = place_labels(requests, area, np.zeros((0, 2)))
    gaps = np.abs(centers[:, None] - centers[None]) - size
    separate = (gaps >= 0).any(axis=2) | np.eye(len(places), dtype=bool)
    assert separate.all()
    assert ((centers - size / 2 >= area[0]) & (centers + size / 2 <= area[1])).all()


def test_the_label_point_of_an_angled_outline_is_inside(flat):
    counter = load_results(flat).surfaces[1]
    x, y = label_point(counter)[:2]
    assert (x < 0.6 and y > 1.6) or y > 2.8
