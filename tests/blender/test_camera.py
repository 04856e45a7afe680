"""The keyed camera is the trajectory, and sees through K."""

import json
import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender.open import scene  # noqa: E402
from iclnuim.blender.render import camera  # noqa: E402
from iclnuim.geometry import axes, so3  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.geometry.continuous import RecipeMotion, frames_at, keys_between, stamps_at  # noqa: E402
from iclnuim.geometry.handheld import Recipe  # noqa: E402
from iclnuim.geometry.se3 import SE3  # noqa: E402
from iclnuim.geometry.trajectory import sample  # noqa: E402

CAMERAS = [
    PinholeCamera(),
    PinholeCamera(640, 480, 481.2, 480.0, 300.25, 260.5),
    PinholeCamera(320, 480, 300.0, 410.0, 150.0, 250.0),
    PinholeCamera(640, 200, 500.0, 350.0, 319.5, 99.5),
]


def random_poses(count, seed):
    rng = np.random.default_rng(seed)
    return SE3.exp(rng.normal(size=(count, 6)) * [2, 2, 2, 1.5, 1.5, 1.5])


def test_the_keyed_camera_stands_where_the_poses_say():
    scene.open_empty()
    T = random_poses(40, 1)
    thing = camera.keyframe(T, PinholeCamera())
    wanted = axes.world_blender_from_world_cv(T).matrix
    for frame in range(40):
        bpy.context.scene.frame_set(frame)
        assert np.abs(np.array(thing.matrix_world) - wanted[frame]).max() < 2e-6


def test_quaternion_keys_never_turn_the_long_way_round():
    scene.open_empty()
    turning = SE3(
        so3.exp(np.linspace(0, 4 * np.pi, 90)[:, None] * [0.0, 0.0, 1.0]), np.zeros((90, 3))
    )
    thing = camera.keyframe(turning, PinholeCamera())
    before = None
    for frame in np.arange(0, 89, 0.5):
        bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
        now = np.array(thing.matrix_world)[:3, :3]
        if before is not None:
            assert np.degrees(so3.angle(before.T @ now)) < 4.5
        before = now


@pytest.mark.parametrize("pinhole", CAMERAS)
def test_blender_projects_points_to_the_pixels_of_k(pinhole):
    from bpy_extras.object_utils import world_to_camera_view

    scene.open_empty()
    T = random_poses(1, 2)
    thing = camera.keyframe(T, pinhole)
    bpy.context.scene.frame_set(0)
    bpy.context.view_layer.update()
    rng = np.random.default_rng(3)
    pixels = rng.uniform((0, 0), (pinhole.width - 1, pinhole.height - 1), (50, 2))
    rays = np.concatenate(
        [(pixels - (pinhole.cx, pinhole.cy)) / (pinhole.fx, pinhole.fy), np.ones((50, 1))], -1
    )
    points = T[0].apply(rays * rng.uniform(0.5, 5, (50, 1)))
    for pixel, point in zip(pixels, points, strict=True):
        x, y, _ = world_to_camera_view(
            bpy.context.scene, thing, __import__("mathutils").Vector(point)
        )
        assert (
            np.hypot(x * pinhole.width - 0.5 - pixel[0], (1 - y) * pinhole.height - 0.5 - pixel[1])
            < 2e-3
        )


def test_between_frames_the_camera_is_on_the_path_of_the_recipe_to_a_micrometre(repository):
    scene.open_empty()
    content = (repository / "trajectories/living_room/kt2.json").read_text()
    motion = RecipeMotion(Recipe.from_dict(json.loads(content)))
    poses = motion.trajectory[:90]
    frames, T = keys_between(motion, poses, beyond=1)
    thing = camera.keyframe(T, PinholeCamera(), frames)
    places = np.random.default_rng(0).uniform(-0.9, 89.9, 200)
    stamps_s = stamps_at(poses, places)
    assert np.abs(frames_at(poses, stamps_s) - places).max() < 1e-9
    wanted = axes.world_blender_from_world_cv(motion.states(stamps_s).T_world_body).matrix
    inside_s = stamps_s.clip(*poses.stamps_s[[0, -1]])
    straight = axes.world_blender_from_world_cv(sample(poses, inside_s)).matrix
    off_m, straight_off_m = [], []
    for place, exact, chord in zip(places, wanted, straight, strict=True):
        bpy.context.scene.frame_set(math.floor(place), subframe=place % 1)
        found = np.array(thing.matrix_world)
        off_m.append(np.abs(found - exact).max())
        straight_off_m.append(np.abs(chord - exact)[:3, 3].max())
    assert max(off_m) < 3e-6
    assert max(straight_off_m) > 1e-4
    for frame in (0, 44, 89):
        bpy.context.scene.frame_set(frame)
        keyed = axes.world_blender_from_world_cv(poses.T_world_camera[frame]).matrix
        assert np.abs(np.array(thing.matrix_world) - keyed).max() < 2e-6
