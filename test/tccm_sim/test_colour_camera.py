"""What a colour camera makes of a wall and of what hangs on it."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_sim.colour_camera import ColourCamera, ColourRenderer, exposed
from tccm_sim.panels import Panel, on_wall, panel_arrays
from tccm_sim.rigid import rigid
from tccm_sim.scene import Scene

CAMERA = ColourCamera(width=160, height=120, focal=140.0, period=0.5, sigma=0.0, gain=0.0)
OPTICAL = rigid((0.0, 0.0, 1.2), (-np.pi / 2, 0.0, -np.pi / 2))
"""The camera looks along x, 1.2 m over the floor."""


def white_panel(width=0.4, at=(3.0, 0.2), height=1.3):
    pixels = np.full((100, 200, 3), 255, np.uint8)
    return Panel(pixels, on_wall(at, height, (-1.0, 0.0)), width)


def renderer(*panels, x=3.0):
    scene = Scene()
    scene.block("wall", (x, x + 0.1), (-4.0, 4.0), (0.0, 4.0), role="wall")
    scene.block("floor", (-5.0, 5.0), (-5.0, 5.0), (-0.1, 0.0), role="floor")
    return ColourRenderer(scene.freeze(), panel_arrays(panels))


def still(pose=OPTICAL):
    return np.repeat(pose[None], 4, axis=0)


def weights_of_panel(picture, without):
    """Return how much of each pixel the panel covers, from a picture with and one without it."""
    difference = (picture - without).mean(axis=2)
    return np.clip(difference / difference.max(), 0.0, 1.0)


def centroid(weights):
    v, u = np.indices(weights.shape)
    return np.array([(u * weights).sum(), (v * weights).sum()]) / weights.sum()


@pytest.mark.parametrize("yaw", [0.0, 0.35, -0.5])
def test_a_panel_is_where_the_pinhole_model_has_it(yaw):
    T = rigid((0.0, 0.0, 0.0), (0.0, 0.0, yaw)) @ OPTICAL
    panel = white_panel(at=(3.0, 3.0 * np.tan(yaw)), width=0.2)
    picture = renderer(panel).render(CAMERA, still(T), 0.0)
    weights = weights_of_panel(picture, renderer().render(CAMERA, still(T), 0.0))
    q = np.linalg.inv(T) @ [*panel.position, 1.0]
    expected = CAMERA.focal * q[:2] / q[2] + np.array(CAMERA.center)
    # Seen at an angle, the nearer half is larger: a tenth of a pixel at 0.5 rad.
    assert centroid(weights) == pytest.approx(expected, abs=0.25)


def test_a_panel_has_its_size_and_is_not_mirrored():
    pixels = np.zeros((100, 200, 3), np.uint8)
    pixels[:50, :100] = 255  # upper left, for who looks at it
    panel = Panel(pixels, on_wall((3.0, 0.0), 1.2, (-1.0, 0.0)), 1.0)
    picture = renderer(panel).render(CAMERA, still(), 0.0).mean(axis=2)
    u, v = 79.5, 59.5
    assert picture[int(v) - 5, int(u) - 10] > 200 > 40 > picture[int(v) - 5, int(u) + 10]
    assert picture[int(v) + 5, int(u) - 10] < 40
    seen = renderer(white_panel(width=1.0, at=(3.0, 0.0), height=1.2)).render(CAMERA, still(), 0.0)
    weights = weights_of_panel(seen, renderer().render(CAMERA, still(), 0.0))
    # The lighter parts of the wall differ less from white: half of the difference is the edge.
    assert (weights > 0.3).sum() == pytest.approx((140 / 3.0) ** 2 * 0.5, rel=0.05)


def test_objects_before_a_panel_hide_it():
    panel = white_panel()
    scene = Scene()
    scene.block("wall", (3.0, 3.1), (-4.0, 4.0), (0.0, 4.0), role="wall")
    scene.block("cupboard", (1.5, 2.0), (-1.0, 1.0), (0.0, 3.0))
    hidden = ColourRenderer(scene.freeze(), panel_arrays([panel]))
    bare = ColourRenderer(scene.freeze(), panel_arrays([]))
    np.testing.assert_array_equal(
        hidden.render(CAMERA, still(), 0.0), bare.render(CAMERA, still(), 0.0)
    )


def test_rotation_during_the_exposure_smears_a_panel_by_as_many_pixels():
    yaw_change = 0.06  # rad, 8.4 pixels
    yaws = yaw_change * ((np.arange(4) + 0.5) / 4 - 0.5)
    moving = np.array([rigid((0, 0, 0), (0, 0, yaw)) @ OPTICAL for yaw in yaws])
    panel = white_panel(at=(3.0, 0.0), width=0.3)
    sharp, smeared = (
        weights_of_panel(renderer(panel).render(CAMERA, T, 0.0), renderer().render(CAMERA, T, 0.0))
        for T in (still(), moving)
    )
    deviation = [np.sqrt(np.cov(np.indices(w.shape)[1].ravel(), aweights=w.ravel())) for w in
                 (sharp, smeared)]  # fmt: skip
    spread = np.sqrt(np.mean((CAMERA.focal * yaws) ** 2))
    assert deviation[1] ** 2 - deviation[0] ** 2 == pytest.approx(spread**2, rel=0.2)


def test_small_pictures_of_a_fine_pattern_are_grey():
    pixels = np.zeros((256, 256, 3), np.uint8)
    pixels[::2] = 255
    panel = Panel(pixels, on_wall((3.0, 0.0), 1.2, (-1.0, 0.0)), 0.6)
    picture = renderer(panel).render(CAMERA, still(), 0.0).mean(axis=2)
    middle = picture[50:70, 70:90]
    assert middle.std() < 0.1 * middle.mean()


def test_noise_and_gain_are_those_of_the_camera():
    picture = np.full((120, 160, 3), 100.0, np.float32)
    noisy = exposed(replace(CAMERA, sigma=4.0), picture, np.random.default_rng(1)).astype(float)
    flat = exposed(CAMERA, picture, np.random.default_rng(1)).astype(float)
    assert (noisy - flat).std() == pytest.approx(np.hypot(4.0, 0.4), rel=0.05)
    assert flat[60, 80] == pytest.approx(100.0, abs=1.0)
    assert flat[0, 0].mean() < 0.9 * flat[60, 80].mean()
    levels = [
        exposed(replace(CAMERA, gain=0.1), picture, np.random.default_rng(seed))[60, 80, 0] / 100.0
        for seed in range(200)
    ]
    assert np.std(levels) == pytest.approx(0.1, rel=0.25)
