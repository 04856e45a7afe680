"""The level of detail: fewer triangles and larger error step by step, for every shipped scene; full
detail is untouched; chamfers go, thin and round things stay.
"""

import numpy as np
import pytest
from iclnuim.blend.builder.coarsening import coarser, feature_m
from iclnuim.blend.builder.mesh import face_normals, join
from iclnuim.blend.builder.shapes import lathe, sheet, tube
from iclnuim.blend.builder.solids import block
from iclnuim.geometry.camera import PinholeCamera

bpy = pytest.importorskip(
    "bpy", reason="needs the bpy package"
)  # before open3d: both bring a TBB, and bpy 5.2 needs its own
pytest.importorskip("embreex")


def test_a_chamfered_box_becomes_the_box_about_it():
    box = coarser(block((0.4, 0.3, 0.2), (1, 2, 3), 0.002), 0.004)
    assert box.triangles() == 12
    assert np.ptp(box.verts, axis=0) == pytest.approx([0.4, 0.3, 0.2], abs=5e-5)
    assert (np.abs(face_normals(box)).max(1) > 0.99999).all()
    outwards = np.einsum("ij,ij->i", face_normals(box), box.verts[box.faces[:, 0]] - [1, 2, 3])
    assert (outwards > 0).all()


def test_what_is_round_or_thin_or_apart_keeps_its_form():
    flat = np.stack(np.meshgrid(np.linspace(0, 0.21, 4), np.linspace(0, 0.3, 4)), -1)
    page = sheet(np.concatenate([flat, 0 * flat[..., :1]], -1), 0.0006)
    ball = lathe([(0.05 * np.sin(a), 0.05 * np.cos(a)) for a in np.linspace(np.pi, 0, 12)], 16)
    wire = tube([(0, 0, 0), (0, 0, 1)], 0.004, 12)
    for thing in (page, ball, wire):
        less = coarser(thing, 0.004)
        assert np.ptp(less.verts, axis=0) == pytest.approx(np.ptp(thing.verts, axis=0), abs=0.004)
        assert less.triangles() > 0
    two = coarser(join([block((0.1, 0.1, 0.1)), block((0.1, 0.1, 0.1), (0.1004, 0, 0))]), 0.004)
    assert two.triangles() == 24
    assert two.verts[:, 0].max() == pytest.approx(0.1504, abs=5e-5)


def test_nothing_goes_at_full_detail_and_more_and_more_below():
    assert feature_m(1.0) == feature_m(2.0) == 0.0
    assert 0 < feature_m(0.7) < feature_m(0.5) < feature_m(0.25)
    thing = block((0.4, 0.3, 0.2))
    assert coarser(thing, 0.0) is thing


@pytest.mark.parametrize("room", ["living_room", "office"])
def test_less_detail_is_fewer_triangles_and_a_larger_error_in_every_room(
    room, small_textures, repository
):
    """Full detail is the shipped file: test_living_room.py and test_office.py compare it with what
    the code builds.
    """
    from iclnuim.blend.builder import build_scene
    from iclnuim.blender import surfaces
    from iclnuim.blender.open import scene
    from iclnuim.raycast.caster import RayCaster
    from iclnuim.trajectory_files.trajectories import read_trajectory

    camera = PinholeCamera.parse("160x120")
    poses = read_trajectory(repository / f"trajectories/{room}/kt2.txt").trajectory.T_world_camera
    triangles = []
    depths = []
    for detail in (1.0, 0.5, 0.25):
        if detail == 1.0:
            scene.open_scene(room)
        else:
            bpy.ops.wm.read_factory_settings(use_empty=True)
            build_scene(room, detail=detail)
        found = surfaces.triangles()
        caster = RayCaster(found.vertices, found.triangles)
        triangles.append(len(found.triangles))
        depths.append(np.stack([caster.depth(camera, poses[n]) for n in (50, 400, 750)]))
    errors = []
    for z in depths[1:]:
        errors.append(np.abs(z - depths[0])[(z > 0) & (depths[0] > 0) & (depths[0] < 15)])
    assert triangles[1] < 0.6 * triangles[0] and triangles[2] < 0.75 * triangles[1]
    assert 0 < errors[0].mean() < 0.004 and errors[0].mean() < errors[1].mean() < 0.01
    assert (errors[1] < 0.02).mean() > 0.96  # it is still the same room
