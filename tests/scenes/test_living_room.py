"""The living room: what the code builds, what the file holds, how both agree with the original."""

import re

import cv2
import numpy as np
import pytest
from iclnuim.blend.builder import build_scene
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.shipped import SCENES
from iclnuim.trajectory_files.trajectories import read_trajectory

OFFICIAL = {"kt0": (0, 1, 50), "kt2": range(180, 190, 3)}
SINGLE_SHEETS = {
    "curtain_left",
    "curtain_right",
    "lamp_shade_corner",
    "lamp_shade_window",
    "window_pane",
    "view",
    "shrub_1",
    "shrub_2",
}
OPAQUE = {
    "BSDF_DIFFUSE",
    "BSDF_GLOSSY",
    "FRESNEL",
    "MIX_SHADER",
    "TEX_IMAGE",
    "UVMAP",
    "OUTPUT_MATERIAL",
}
SPECIAL = {"BSDF_TRANSPARENT", "BSDF_TRANSLUCENT", "EMISSION"}


def official_poses(samples, kt):
    return read_trajectory(
        samples / f"trajectories/lr_{kt}_Tpov_cam_3x4.txt", "pov-matrix"
    ).trajectory.T_world_camera


def official_depth(samples, kt, number):
    if kt == "kt0":
        return cv2.imread(str(samples / f"lr_kt0/image_depth_{number}.pgm"), -1) / 1000.0
    return cv2.imread(str(samples / f"lr_kt2/depth/{number}.png"), -1) / 5000.0


def directions():
    """Viewing rays (h, w, 3) in the cv camera, z = 1."""
    c = PinholeCamera()
    u, v = np.meshgrid(np.arange(c.width), np.arange(c.height))
    return np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones_like(u, float)], -1)


def test_the_registry_is_read_without_building_and_names_what_it_has():
    assert "living_room" in SCENES
    with pytest.raises(InputError, match="living_room"):
        build_scene("no such room")


def test_it_stays_within_its_means(built):
    assert 60_000 < built.triangles <= 150_000


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(build):
    first = build(3, 0.15)
    again = build(3, 0.15)
    other = build(4, 0.15)
    assert first.sha256 == again.sha256 != other.sha256
    assert first.objects == other.objects
    assert first.triangles < 60_000


def test_every_object_has_a_stable_number_and_a_class(built):
    numbers = sorted(number for number, _ in built.objects.values())
    assert numbers == list(range(1, len(numbers) + 1))
    classes = {name for _, name in built.objects.values()}
    assert {
        "wall",
        "floor",
        "ceiling",
        "sofa",
        "pillow",
        "picture",
        "lamp",
        "window",
        "curtain",
        "door",
        "table",
        "chair",
        "television",
        "rug",
        "plant",
    } <= classes


def test_the_command_writes_the_room_and_tells_its_figures(commanded, blender):
    built, figures, file = commanded
    assert figures["geometry_sha256"] == built.sha256
    assert figures["triangles"] == built.triangles
    assert figures["bytes"] == file.stat().st_size < 8e6
    assert [p.name for p in file.parent.iterdir()] == ["room.blend"]
    blender.ops.wm.open_mainfile(filepath=str(file), use_scripts=False)
    from iclnuim.blend.builder import stage

    assert stage.geometry_hash() == built.sha256


def test_the_file_holds_what_the_code_builds(built, opened, blender):
    assert opened.sha256 == built.sha256
    assert opened.objects == built.objects
    for thing in blender.context.scene.objects:
        if thing.type == "MESH":
            assert thing.pass_index == thing["instance_id"]
            assert np.allclose(thing.matrix_world, np.eye(4))
            assert not thing.modifiers


def test_the_file_is_small_and_whole(opened, blender, repository):
    assert (repository / "blend/living_room.blend").stat().st_size < 8e6
    images = [i for i in blender.data.images if i.users and i.type == "IMAGE"]
    assert len(images) > 10
    assert [i.name for i in images if not i.packed_file] == []
    assert len(blender.data.texts) == 0 == len(blender.data.libraries)


def test_meshes_are_valid(opened, blender):
    for mesh in blender.data.meshes:
        area = np.empty(len(mesh.polygons))
        mesh.polygons.foreach_get("area", area)
        assert area.min() > 1e-9, mesh.name
        assert not mesh.validate(), mesh.name
        assert "UVMap" in mesh.uv_layers, mesh.name


def test_materials_keep_the_few_forms_that_baking_understands(opened, blender):
    for material in blender.data.materials:
        kinds = {n.type for n in material.node_tree.nodes}
        assert kinds <= OPAQUE | SPECIAL, material.name
        for node in material.node_tree.nodes:
            if node.type == "BSDF_DIFFUSE":
                assert node.inputs["Roughness"].default_value == 0
                assert not node.inputs["Normal"].is_linked
            if node.type == "UVMAP":
                assert node.uv_map == "UVMap"
        if "EMISSION" in kinds:
            assert material.cycles.emission_sampling == "NONE"


def test_surfaces_turn_their_front_to_the_room(built, rays, rng_directions):
    for eye in ((-1.4, -1.0, 1.5), (0.3, 0.5, 1.2), (-0.6, -2.0, 1.0), (1.2, -1.6, 1.4)):
        _, owner, facing = rays(np.array(eye), rng_directions)
        names = np.array(built.surface.names)[owner[owner >= 0]]
        solid = ~np.isin(names, list(SINGLE_SHEETS))
        wrong = names[solid & (facing[owner >= 0] > 1e-3)]
        assert len(wrong) <= 1e-5 * len(names), set(
            wrong
        )  # a ray through an edge may meet the inside


def test_no_two_objects_share_a_visible_surface(built, rays, rng_directions):
    """A second object within 20 micrometres behind the first would flicker."""
    eye = np.array((0.2, 0.4, 1.3))
    distance, owner, _ = rays(eye, rng_directions)
    seen = owner >= 0
    start = eye + rng_directions[seen] * (distance[seen, None] - 2e-5)
    lines = np.concatenate([start, rng_directions[seen]], -1).astype(np.float32)
    counts = rays.caster.list_intersections(lines)
    splits = counts["ray_splits"].numpy()
    near = counts["t_hit"].numpy() < 4e-5
    owners = built.surface.owners[counts["primitive_ids"].numpy()]
    shared = []
    for i in range(len(splits) - 1):
        if len(set(owners[splits[i] : splits[i + 1]][near[splits[i] : splits[i + 1]]])) > 1:
            shared.append(i)
    assert len(shared) <= 1e-4 * len(start), {
        tuple(built.surface.names[o] for o in owners[splits[i] : splits[i + 1]][:2]) for i in shared
    }


@pytest.fixture(scope="module")
def rng_directions():
    d = np.random.default_rng(4).normal(size=(200_000, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("kt", list(OFFICIAL))
def test_bare_floor_ceiling_and_walls_agree_with_official_depth_to_a_centimetre(
    samples, built, rays, kt
):
    poses = official_poses(samples, kt)
    agreed = []
    bare = []
    for number in OFFICIAL[kt]:
        truth = official_depth(samples, kt, number)
        T = poses[number]
        depth, owner, _ = rays(T.translation, directions() @ T.rotation.T)
        plane = np.isin(
            owner,
            [
                i
                for i, n in enumerate(built.surface.names)
                if n.startswith("wall_") or n in ("floor", "ceiling")
            ],
        )
        bare.append(plane.mean())
        agreed.append((np.abs(depth - truth)[plane & (truth > 0)] < 0.01).mean())
    assert min(bare) > 0.4
    assert min(agreed) > 0.97, agreed


@pytest.mark.parametrize("kt", list(OFFICIAL))
def test_nine_tenths_of_each_frame_lie_within_3_cm_of_the_original(samples, built, rays, kt):
    for number in OFFICIAL[kt]:
        T = official_poses(samples, kt)[number]
        truth = official_depth(samples, kt, number)
        depth, _, _ = rays(T.translation, directions() @ T.rotation.T)
        assert (np.abs(depth - truth)[truth > 0] < 0.03).mean() > 0.9, number


@pytest.mark.parametrize("kt", list(OFFICIAL))
def test_the_official_paths_keep_20_cm_from_every_surface(samples, built, rays, kt):
    positions = official_poses(samples, kt).translation.astype(np.float32)
    distance = rays.caster.compute_distance(positions).numpy()
    assert distance.min() > 0.20, (int(distance.argmin()), positions[distance.argmin()])


def test_the_page_of_facts_lists_every_object(built, repository):
    text = (repository / "blend/README.md").read_text().partition("## The office")[0]
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (\w+) \|", text, re.M)
    listed = {name: (int(number), kind) for number, name, kind in rows}
    assert listed == built.objects
    assert f"{built.triangles:,}" in text
