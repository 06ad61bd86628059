"""What a depth camera makes of distances."""

from dataclasses import replace

import numpy as np
import pytest

from tccm_sim.cameras import measure_depths
from tccm_sim.heads import D435, XTION
from tccm_sim.scene import Scene

BARE = replace(XTION, flying=0.0, grazing=0.0, lost=0.0)
STRAIGHT = np.ones((240, 320))


def random():
    return np.random.default_rng(4)


def plane(distance):
    return np.full((240, 320), distance)


def test_rays_follow_the_pinhole_model_with_z_forward_and_y_down():
    rays = XTION.rays.reshape(240, 320, 3)
    v, u = 17, 203
    expected = np.array([(u - 159.5) / 285.0, (v - 119.5) / 285.0, 1.0])
    assert rays[v, u] == pytest.approx(expected / np.linalg.norm(expected))
    assert rays[:, 0, 0].max() < 0.0 < rays[:, -1, 0].min()
    assert rays[0, :, 1].max() < 0.0 < rays[-1, :, 1].min()


@pytest.mark.parametrize("camera", [XTION, D435])
@pytest.mark.parametrize("distance", [0.8, 1.7, 3.1])
def test_noise_of_a_plane_grows_with_the_square_of_its_distance(camera, distance):
    bare = replace(camera, flying=0.0, grazing=0.0, lost=0.0)
    depths = measure_depths(bare, plane(distance), STRAIGHT, random()) / 1000.0
    sigma = camera.sigma(np.array([distance]))[0]
    assert sigma / distance**2 == pytest.approx(camera.sigma(np.array([1.0]))[0])
    # Steps of the disparity that are wider than its noise make the bias and the spread depend on
    # where the true disparity lies between steps; the mean over a slope of depths does not.
    slope = np.linspace(0.97, 1.03, 320) * plane(distance)
    errors = measure_depths(bare, slope, STRAIGHT, random()) / 1000.0 - slope
    assert errors.std() == pytest.approx(np.hypot(sigma, 0.001 / np.sqrt(12)), rel=0.06)
    assert abs(errors.mean()) < 0.05 * sigma + 3e-4  # depths are rounded to 1 mm
    assert np.median(depths) == pytest.approx(distance, abs=2.5 * sigma + 0.001)


def test_disparities_are_multiples_of_their_step():
    camera = replace(BARE, disparity_sigma=0.5)
    depths = measure_depths(camera, plane(2.0), STRAIGHT, random())
    disparities = camera.disparity_scale / (depths / 1000.0)
    steps = disparities / camera.disparity_step
    # A depth of 2 m is rounded to 1 mm, which is 0.09 steps.
    assert np.abs(steps - np.round(steps)).max() < 0.1
    assert len(np.unique(depths)) < 60


def test_depths_outside_the_limits_grazing_and_lost_ones_are_zero():
    depths = np.array([[0.3, 1.0, 6.0, np.inf]])
    quiet = replace(BARE, disparity_sigma=0.0, disparity_step=0.0)
    assert measure_depths(quiet, depths, np.ones((1, 4)), random()).tolist() == [[0, 1000, 0, 0]]
    grazing = replace(quiet, grazing=0.1)
    cosines = np.array([[0.05, 0.2]])
    assert measure_depths(grazing, np.ones((1, 2)), cosines, random()).tolist() == [[0, 1000]]
    lost = measure_depths(replace(quiet, lost=0.2), plane(1.0), STRAIGHT, random())
    assert (lost == 0).mean() == pytest.approx(0.2, abs=4 * np.sqrt(0.16 / lost.size))


@pytest.mark.parametrize("axis", [0, 1])
def test_flying_pixels_are_between_both_sides_of_an_edge(axis):
    camera = replace(BARE, disparity_sigma=0.0, disparity_step=0.0, flying=0.4)
    depths = np.where(np.indices((240, 320))[axis] < 100, 1.0, 2.0)
    image = measure_depths(camera, depths, STRAIGHT, random())
    between = np.moveaxis((image > 1001) & (image < 1999), axis, 0)
    assert between[99].mean() == pytest.approx(0.4, abs=4 * np.sqrt(0.24 / between.shape[1]))
    assert not between[:99].any()
    assert not between[100:-1].any()


def test_cosines_are_those_of_the_angle_of_incidence():
    scene = Scene()
    scene.box("slope", (4.0, 4.0, 1.0), (0.0, 0.0, 3.0), (0.3, 0.0, 0.0))
    scene.cylinder("pillar", 0.5, 1.0, (8.0, 0.0, 0.0))
    frozen = scene.freeze()
    up, ahead = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    for origin, ray, expected in (
        ((0.0, 0.0, 0.0), up, np.cos(0.3)),
        ((6.0, 0.0, 0.0), ahead, 1.0),
        ((6.0, 0.3, 0.0), ahead, 0.8),
        ((6.0, 2.0, 0.0), ahead, 1.0),
    ):
        origins = np.array([origin])
        ranges, codes = frozen.cast(origins, ray, np.zeros(1))
        assert frozen.cosines(origins, ray, ranges, codes) == pytest.approx(expected)
