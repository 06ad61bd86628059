"""Rays against closed forms and against a brute-force twin in numpy."""

from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_sim.raycast import FACES
from tccm_sim.scene import Motion, Scene

X, Y, Z = np.eye(3)


def one_ray(scene, origin, direction, time=0.0):
    """Return distance and code of one ray."""
    d = np.asarray(direction, float)
    ranges, codes = scene.freeze().cast(
        np.array([origin], float), (d / np.linalg.norm(d))[None], np.array([time])
    )
    return ranges[0], codes[0]


def march(solids, origin, direction, step=2e-4, max_range=6.0):
    """Return the distance along a ray by small steps until a point is inside a solid."""
    t = np.arange(0.0, max_range, step)
    points = origin + t[:, None] * direction
    inside = np.zeros(len(t), bool)
    for solid in solids:
        local = (points - solid.T_world_solid[:3, 3]) @ solid.T_world_solid[:3, :3]
        if solid.shape == "box":
            inside |= np.all(np.abs(local) <= solid.half, axis=1)
        else:
            inside |= (np.hypot(local[:, 0], local[:, 1]) <= solid.half[0]) & (
                np.abs(local[:, 2]) <= solid.half[2]
            )
    return t[np.argmax(inside)] if inside.any() else np.inf


def test_a_ray_at_45_degrees_hits_the_floor():
    scene = Scene()
    scene.floor_and_ceiling((-5, 5), (-5, 5))
    distance, code = one_ray(scene, (0, 0, 1.5), (1, 0, -1))
    assert distance == pytest.approx(1.5 * np.sqrt(2))
    assert code == 5


def test_codes_distinguish_the_faces_of_a_box():
    scene = Scene()
    scene.block("box", (1, 2), (-0.5, 0.5), (0, 1))
    assert one_ray(scene, (0, 0, 0.5), X) == (pytest.approx(1.0), 0)
    assert one_ray(scene, (3, 0, 0.5), -X) == (pytest.approx(1.0), 1)
    assert one_ray(scene, (1.5, 2, 0.5), -Y) == (pytest.approx(1.5), 3)
    assert one_ray(scene, (1.5, 0, 3), -Z) == (pytest.approx(2.0), 5)
    assert one_ray(scene, (0, 0, 1.5), X) == (np.inf, -1)


def test_rays_hit_the_side_and_the_caps_of_a_cylinder():
    scene = Scene()
    scene.cylinder("can", 0.1, 0.4, (1.0, 0.0, 0.2))
    assert one_ray(scene, (0, 0, 0.2), X) == (pytest.approx(0.9), 0)
    assert one_ray(scene, (0, 0.06, 0.2), X) == (pytest.approx(1.0 - 0.08), 0)
    assert one_ray(scene, (1.05, 0, 1), -Z) == (pytest.approx(0.6), 5)
    assert one_ray(scene, (0, 0.11, 0.2), X) == (np.inf, -1)


def test_the_face_of_a_wall_is_on_the_left_of_its_direction():
    scene = Scene()
    scene.wall("wall", (2.0, -1.0), (2.0, 1.0), thickness=0.1)
    assert one_ray(scene, (0, 0, 1), X)[0] == pytest.approx(2.0)
    assert one_ray(scene, (4, 0, 1), -X)[0] == pytest.approx(1.9)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_rays_hit_the_same_distance_as_a_march_in_small_steps(seed):
    """With many solids rays use the grid; the march tests all solids."""
    random = np.random.default_rng(seed)
    scene = Scene()
    for i in range(40):
        center, rpy = random.uniform(-2.5, 2.5, 3), random.uniform(-3, 3, 3)
        size = random.uniform(0.1, 0.7, 3)
        if i % 2:
            scene.box("box", size, center, tuple(rpy))
        else:
            scene.cylinder("can", size[0] / 2, size[1], center, tuple(rpy))
    with patch("tccm_sim.scene.CELL", 0.5):  # so that a ray passes several cells
        frozen = scene.freeze()
    directions = random.standard_normal((10, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = 4.0 * np.sign(random.standard_normal((10, 3)))  # outside all solids
    directions = np.where(np.sign(directions) == np.sign(origins), -directions, directions)
    ranges, codes = frozen.cast(origins, directions, np.zeros(10), 12.0)
    for o, d, distance, code in zip(origins, directions, ranges, codes):
        twin = march(scene.solids, o, d, step=2e-3, max_range=12.0)
        if np.isfinite(twin):  # the marcher may step over a grazed corner, never invent one
            assert distance <= twin + 1e-9
        if distance < twin - 3e-3:
            just_inside = o + (distance + 1e-7) * d
            solid = scene.solids[code // FACES]
            local = (just_inside - solid.T_world_solid[:3, 3]) @ solid.T_world_solid[:3, :3]
            assert np.all(np.abs(local) <= np.array(solid.half) + 1e-6)


def test_a_moving_solid_is_hit_at_its_position_at_the_time_of_the_beam():
    scene = Scene()
    motion = Motion.through([(0.0, 0, 0, 0), (10.0, 5.0, 0, 0)])
    scene.box("cart", (0.2, 0.2, 1.0), (1.0, 0.0, 0.5), motion=motion)
    frozen = scene.freeze()
    times = np.array([2.0, 3.0, 4.0])
    origins = np.tile([0.0, 0.0, 0.5], (3, 1))
    ranges, _ = frozen.cast(origins, np.tile(X, (3, 1)), times)
    assert ranges == pytest.approx([0.9 + 1.0, 0.9 + 1.5, 0.9 + 2.0])


@given(st.floats(-1.0, 12.0))
def test_a_motion_is_interpolated_between_its_keys(time):
    motion = Motion.through([(0.0, 0.1, 0, 0), (1.5, 0.7, -2.0, 0, 0.3), (10.0, 5.0, 0, 1, -0.2)])
    expected = [np.interp(time, motion.times, column) for column in motion.offsets.T]
    assert motion.at(time).tolist() == expected


def test_solids_are_hit_within_their_time_only():
    scene = Scene()
    scene.box("parcel", (0.2, 0.2, 0.2), (1, 0, 0), span=(2.0, 5.0))
    for time, distance in ((1.9, np.inf), (2.0, 0.9), (4.9, 0.9), (5.0, np.inf)):
        assert one_ray(scene, (0, 0, 0), X, time)[0] == pytest.approx(distance)


def test_the_top_of_a_table_is_at_its_height():
    scene = Scene()
    scene.table("table", (1.2, 0.8), 0.7, (1.0, 0.0), 0.4)
    assert one_ray(scene, (1.0, 0.0, 2.0), -Z)[0] == pytest.approx(1.3)
    assert one_ray(scene, (1.0, 0.0, 0.1), Z)[0] == pytest.approx(0.7 - 0.03 - 0.1)
