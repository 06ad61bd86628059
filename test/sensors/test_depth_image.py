"""From depths to points: rays, edges, thinning, noise, against numpy twins and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import CameraInfo, DepthImage, SelfShapes
from tccm_ros.sensors.camera_rays import distort, pixel_rays
from tccm_ros.sensors.depth_image import (
    NOT_OPTICAL,
    TOO_FAR,
    PosedImage,
    camera_info_topic,
    depth_stream,
    fault_of_pose,
    join_camera,
    max_mapped_depth,
    measure_image,
    rejection_reason,
)
from tccm_ros.sensors.depth_kernels import DepthLimits, SightLines, place_image

BLOCK = 8  # pixels, edge of a block

W, H, F = 64, 48, 60.0
K = np.array([[F, 0.0, 31.5], [0.0, F, 23.5], [0.0, 0.0, 1.0]])
CAMERA = CameraInfo(0, "eye", W, H, "plumb_bob", np.zeros(5), K, np.hstack([K, np.zeros((3, 1))]))
PLUMB_BOB = np.array([-0.28, 0.07, 0.0008, -0.0005, 0.01])
RATIONAL = np.array([0.3, -0.1, 0.0005, 0.0004, 0.02, 0.6, -0.05, 0.03])


@pytest.mark.parametrize("D", [np.zeros(0), np.zeros(5), PLUMB_BOB, RATIONAL])
@pytest.mark.parametrize("crop", [((1, 1), (0, 0, 0, 0)), ((2, 2), (8, 4, 40, 36))])
def test_each_ray_is_projected_back_to_its_pixel(D, crop):
    """The forward projection is a closed form; rays are its inverse, by binning and region too."""
    camera = replace(CAMERA, D=D, binning=crop[0], region=crop[1])
    rays = pixel_rays(camera).astype(np.float64)
    width, height = camera.image_size
    assert rays.shape == (2, height, width)
    x, y = distort(rays[0], rays[1], D)
    u, v = F * x + K[0, 2], F * y + K[1, 2]
    np.testing.assert_allclose(u, np.arange(width) * crop[0][0] + crop[1][0] + 0 * u, atol=1e-3)
    expected = (np.arange(height) * crop[0][1] + crop[1][1])[:, None] + 0 * v
    np.testing.assert_allclose(v, expected, atol=1e-3)


def test_a_rectified_image_has_the_rays_of_its_projection():
    P = np.array([[50.0, 0, 30, 0], [0, 50.0, 20, 0], [0, 0, 1, 0]])
    rays = pixel_rays(replace(CAMERA, D=PLUMB_BOB, P=P).rectified())
    np.testing.assert_allclose(rays[:, 20, 30], 0.0, atol=1e-6)
    np.testing.assert_allclose(rays[:, 0, 0], [-0.6, -0.4], atol=1e-6)


def test_pixels_outside_the_lens_have_no_ray():
    strong = np.array([-0.9, 0.0, 0.0, 0.0, 0.0])  # r (1 - 0.9 r^2) is at most 0.406
    rays = pixel_rays(replace(CAMERA, D=strong))
    assert np.isnan(rays[:, 0, 0]).all()
    assert np.isfinite(rays[:, 23, 31]).all()


# -- kernels and their twins


def edges_twin(z, step_u, step_v, slope, noise):
    usable = z > 0.0
    dropped = np.zeros(z.shape, bool)
    for axis, step in ((1, step_u), (0, step_v)):
        a = z[:, :-1] if axis == 1 else z[:-1]
        b = z[:, 1:] if axis == 1 else z[1:]
        near = np.minimum(a, b)
        allowed = np.float32(slope * step) * near + np.float32(noise[0])
        allowed = allowed + np.float32(noise[1]) * (near - np.float32(noise[2])) ** 2
        jump = (np.abs(a - b) > allowed) & (near > 0.0)
        if axis == 1:
            dropped[:, :-1] |= jump
            dropped[:, 1:] |= jump
        else:
            dropped[:-1] |= jump
            dropped[1:] |= jump
    return usable & ~dropped


def lone_twin(usable):
    """Return which pixels have no neighbour along one of the image directions."""
    padded = np.pad(usable, 1)
    beside = padded[1:-1, :-2] | padded[1:-1, 2:]
    above = padded[:-2, 1:-1] | padded[2:, 1:-1]
    return usable & ~(beside & above)


def place(depth, rays, *, half=0.0, max_z=20.0, every=0, max_depth=20.0, unit=1.0, slope=1e6):
    """Return the points of the kernel, where lines of sight end, and whether on a surface."""
    steps = 1 / F, 1 / F
    edges = np.array([slope * steps[0], slope * steps[1], *NOISE], np.float32)
    limits = DepthLimits(
        np.float32(unit), np.float32(max_depth), edges, np.float32(max_z), half, steps
    )
    sight = SightLines(every, np.array([0.003, 0.006, 0.4]))
    points, ends = np.empty((depth.size, 3)), np.empty((depth.size, 3))
    hits, T = np.empty(depth.size, np.bool_), np.eye(4)[:3].copy()
    n, lines = place_image(depth, rays, limits, sight, T, points, ends, hits)
    return points[:n], ends[:lines], hits[:lines]


NOISE = 0.004, 0.008, 0.4
images = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 19), st.integers(1, 20)).map(
    lambda a: np.random.default_rng(a[0]).choice(
        np.array([0, 500, 510, 520, 900, 2500], np.uint16),
        a[1:],
        p=[0.1, 0.3, 0.3, 0.2, 0.05, 0.05],
    )
)


def pixel_numbers(shape):
    """Return rays that tell each pixel by its direction, float32 (2, H, W)."""
    v, u = np.indices(shape)
    return np.stack([u, v]).astype(np.float32)


@settings(max_examples=100, deadline=None)
@given(images, st.integers(1, 4))
def test_the_pixels_on_surfaces_are_those_of_the_twin(depth, every):
    """Without thinning all that is on no edge, no line of single pixels, and near enough."""
    rays = pixel_numbers(depth.shape)
    rays[:, 0, 0] = np.nan  # not seen through the lens
    points, ends, hits = place(
        depth, rays, max_z=0.8, every=every, max_depth=2.0, unit=0.001, slope=7.0
    )
    z = np.where(depth > 2000, 0, depth * np.float32(0.001)).astype(np.float32)
    z[0, 0] = 0.0
    usable = edges_twin(z, 1 / F, 1 / F, 7.0, NOISE)
    kept = usable & ~lone_twin(usable) & (z <= np.float32(0.8))
    v, u = np.nonzero(kept)
    found = {tuple(p) for p in np.round(np.c_[points[:, :2] / points[:, 2:], points[:, 2]], 4)}
    assert found == {tuple(p) for p in np.round(np.c_[u, v, z[kept]].astype(float), 4)}
    assert len(points) == len(u)
    on_grid = np.zeros(depth.shape, bool)
    on_grid[every // 2 :: every, every // 2 :: every] = True
    d = z[usable & on_grid].astype(float)
    before = np.maximum(d - 0.003 - 0.006 * (d - 0.4) ** 2, np.float64(np.float32(0.8)))
    np.testing.assert_allclose(ends[:, 2], np.where(d <= np.float32(0.8), d, before), rtol=1e-6)
    np.testing.assert_array_equal(hits, d <= np.float32(0.8))


def plane_image(normal, offset, camera=CAMERA):
    """Return the depths of a plane normal . p = offset in the camera's frame, m."""
    x, y = pixel_rays(camera).astype(np.float64)
    z = offset / (x * normal[0] + y * normal[1] + normal[2])
    return np.where((z > 0.0) & (z < 20.0), z, 0.0).astype(np.float32)


def placed(z, half):
    return place(z, pixel_rays(CAMERA), half=half)[0]


def thinned_twin(z, half):
    """Keep the first pixel of each patch, block by block, by slopes between means of halves."""
    rays, kept = pixel_rays(CAMERA), []
    points = np.dstack([rays[0] * z, rays[1] * z, z]).astype(np.float64)
    for v0 in range(0, H, BLOCK):
        for u0 in range(0, W, BLOCK):
            block = z[v0 : v0 + BLOCK, u0 : u0 + BLOCK].astype(np.float64)
            seen = np.where(block > 0, block, np.nan)
            k = [1, 1]
            halves = seen[:, :4], seen[:, 4:], seen[:4], seen[4:]
            quarters = [(h[r] > 0).any() for h in halves[:2] for r in (slice(4), slice(4, 8))]
            if (block > 0).sum() * 2 >= BLOCK * BLOCK and all(quarters):
                left, right, upper, lower = map(np.nanmean, halves)
                x, y = rays[:, v0 + 4, u0 + 4].astype(float)
                du = np.array([np.nanmean(seen) / F, 0, 0]) + (right - left) / 4 * np.array(
                    [x, y, 1]
                )
                dv = np.array([0, np.nanmean(seen) / F, 0]) + (lower - upper) / 4 * np.array(
                    [x, y, 1]
                )
                k = [min(max(int(half / np.linalg.norm(d)), 1), BLOCK) for d in (du, dv)]
            for v in range(v0, v0 + BLOCK, k[1]):
                for u in range(u0, u0 + BLOCK, k[0]):
                    rows = slice(v, min(v + k[1], v0 + BLOCK))
                    columns = slice(u, min(u + k[0], u0 + BLOCK))
                    patch = points[rows, columns].reshape(-1, 3)
                    kept += patch[patch[:, 2] > 0][:1].tolist()
    return np.array(kept)


@pytest.mark.parametrize("half", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0.8, 0.6), (0.5, -0.5, 0.7)])
def test_the_pixels_that_stay_are_those_of_the_twin(normal, half):
    z = plane_image(np.array(normal, float), 1.0)
    np.testing.assert_allclose(placed(z, half), thinned_twin(z, half), atol=1e-6)


def test_points_are_as_dense_as_asked_and_nothing_sparse_is_thinned():
    z = plane_image(np.array([0.0, 0.3, 0.95]), 1.0)
    whole, half = placed(z, 0.0), 0.12
    kept = placed(z, half)
    assert len(kept) < 0.2 * len(whole)
    distance = np.array([np.linalg.norm(kept - p, axis=1).min() for p in whole[::7]])
    assert distance.max() < half * np.sqrt(2.0)  # the diagonal of a patch
    assert len(placed(z, 0.01)) == len(whole)  # the distance of two pixels is 16 mm


def test_noise_is_no_distance():
    """A noisy wall is thinned as a clean one: the slope is that of means, not of single pixels."""
    clean = np.full((H, W), 1.5, np.float32)
    noisy = clean + np.random.default_rng(0).normal(0.0, 0.004, clean.shape).astype(np.float32)
    assert len(placed(noisy, 0.1)) <= 2.0 * len(placed(clean, 0.1))  # a step less in one direction
    assert len(placed(noisy, 0.1)) < 0.1 * noisy.size


def posed(depth, camera=CAMERA, **options):
    eye = np.eye(4)[None]
    return PosedImage(
        DepthImage(5, "eye", depth, camera), np.array([5]), eye, eye, role="d", **options
    )


def test_noisy_depths_are_looked_through_but_not_mapped():
    config = Config()
    limit = max_mapped_depth(config)
    a, b, c = config.sensors.depth_sigma
    assert a + b * (limit - c) ** 2 == pytest.approx(config.sensors.max_sigma)
    near = measure_image(posed(np.full((H, W), limit - 0.05, np.float32)), config)
    far = measure_image(posed(np.full((H, W), limit + 0.3, np.float32)), config)
    assert len(near.points) > 0
    assert near.hits.all()
    assert len(far.points) == 0
    assert not far.hits.any()
    assert (far.ends[:, 2] <= limit + 0.3 - 3 * config.sensors.max_sigma).all()


def test_mixed_pixels_behind_an_object_are_dropped():
    depth = np.full((H, W), 2.0, np.float32)
    depth[10:30, 20:40] = 1.0
    depth[10:30, 40] = 1.4  # flying pixels, one and two wide
    depth[10:30, 18:20] = [[1.7, 1.3]]
    points = measure_image(posed(depth), Config()).points
    assert len(points) > 0
    assert np.isin(np.round(points[:, 2], 6), [1.0, 2.0]).all()


def test_a_line_of_single_pixels_is_no_surface():
    depth = np.zeros((H, W), np.float32)
    depth[20] = 1.0
    assert len(measure_image(posed(depth), Config()).points) == 0
    depth[21] = 1.0
    assert len(measure_image(posed(depth), Config()).points) > 0


def test_the_robot_itself_is_left_out():
    depth = np.full((H, W), 1.0, np.float32)
    arm = SelfShapes(np.array([0]), np.array([[0.1, 1.0, 0.1]]), np.eye(4)[None].copy())
    arm.T_base_shape[0, 2, 3] = 1.0
    free = measure_image(posed(depth), Config())
    seen = measure_image(posed(depth, own_shapes=arm), Config())
    on_arm = np.abs(free.points[:, 0]) <= 0.1 + Config().scan.self_padding
    np.testing.assert_array_equal(seen.points, free.points[~on_arm])
    assert len(seen.ends) < len(free.ends)


# -- what an image needs


def test_images_of_nothing_are_rejected():
    assert rejection_reason(DepthImage(0, "eye", np.zeros((2, 2), np.uint16))) == "no depths"
    unknown = np.full((2, 2), np.nan, np.float32)
    assert rejection_reason(DepthImage(0, "eye", unknown)) == "no depths"
    assert rejection_reason(DepthImage(0, "eye", np.ones((2, 2), np.uint16))) is None


def test_depths_in_millimetres_and_body_frames_are_rejected():
    stream, ones = depth_stream("depth"), np.ones((2, 2), np.float32)
    assert stream.rejection_reason(DepthImage(0, "eye", 900.0 * ones)) == TOO_FAR
    assert stream.rejection_reason(DepthImage(0, "eye", ones)) is None
    image = posed(np.full((H, W), 1.0, np.float32))
    for rpy, fault in [
        ((0.0, 0.0, 0.0), NOT_OPTICAL),
        ((0.0, 0.5, 0.3), NOT_OPTICAL),
        ((-np.pi / 2, 0.0, -np.pi / 2), None),
        ((-np.pi / 2 - 0.6, 0.0, -np.pi / 2), None),
        ((-np.pi / 2 + 1.0, 0.0, 0.0), None),  # looks up
    ]:
        tilted = replace(image, T_base_sensor=pose_from_rpy((0, 0, 1, *rpy))[None])
        assert fault_of_pose(tilted) == fault


def test_calibration_has_the_stamp_of_the_image_or_is_the_newest_that_fits():
    image = DepthImage(100, "eye", np.ones((H, W), np.uint16))
    old, same, new = (replace(CAMERA, stamp_ns=t) for t in (50, 100, 150))
    assert join_camera(image, (old, same, new), False).camera is same
    assert join_camera(image, (old, new), False).camera is old
    assert join_camera(image, (old, replace(old, stamp_ns=60)), False) is None
    assert join_camera(image, (old, replace(old, stamp_ns=60)), True).camera.stamp_ns == 60
    assert join_camera(image, (old,), False).camera is old  # published once
    assert join_camera(image, (), True) == "no camera info"
    small = replace(same, width=32)
    assert join_camera(image, (small,), True) == "image and camera info of different sizes"
    other = replace(same, frame_id="other")
    assert join_camera(image, (other,), True) == "camera info of another frame"


def test_the_calibration_stands_beside_the_image():
    assert camera_info_topic("depth/image_rect_raw") == "depth/camera_info"
    assert camera_info_topic("/a/b/image/compressedDepth") == "/a/b/camera_info"
    assert camera_info_topic("image") == "camera_info"
