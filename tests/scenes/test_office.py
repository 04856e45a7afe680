"""The office: what the code builds, what the file holds, how it agrees with the original, and that
paths pass through.
"""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.trajectory_files.trajectories import read_trajectory
from judges import judge_module

bpy = pytest.importorskip(
    "bpy", reason="needs the bpy package"
)  # before open3d: both bring a TBB, and bpy 5.2 needs its own
cv2 = pytest.importorskip("cv2")
o3d = judge_module("open3d", "open3d-cpu")

from iclnuim.blend.builder import build_scene, office_textures  # noqa: E402
from iclnuim.tools.official_views import OFFICE  # noqa: E402

LISTED = {
    "wall", "floor", "ceiling", "lamp", "vent", "desk", "cabinet", "monitor", "keyboard", "mouse",
    "computer", "cable", "phone",
    "tray", "bookcase", "books", "picture", "clock", "basket", "stand", "door", "chair", "paper",
    "folder", "board",
}  # fmt: skip
#: Close to which kt0 passes, as the original does.
CEILING = ("ceiling", "ceiling_rails")
OPAQUE = {
    "BSDF_DIFFUSE",
    "BSDF_GLOSSY",
    "FRESNEL",
    "MIX_SHADER",
    "TEX_IMAGE",
    "UVMAP",
    "OUTPUT_MATERIAL",
    "EMISSION",
}


@dataclass(frozen=True)
class Office:
    """Objects by name -> (id, class), surface (vertices, triangles, owners, names), hash,
    triangles, caster.
    """

    objects: dict
    surface: object
    sha256: str
    triangles: int
    caster: object

    def cast(self, origins, directions):
        """Distance, owner (-1: nothing) and cosine between ray and face normal, by Embree."""
        lines = np.concatenate(np.broadcast_arrays(origins, directions), -1).astype(np.float32)
        hit = self.caster.cast_rays(o3d.core.Tensor(lines))
        triangle = hit["primitive_ids"].numpy().astype(np.int64)
        seen = triangle < len(self.surface.triangles)
        owner = np.where(seen, self.surface.owners[np.where(seen, triangle, 0)], -1)
        return hit["t_hit"].numpy(), owner, (hit["primitive_normals"].numpy() * directions).sum(-1)


def captured():
    from iclnuim.blend.builder import stage
    from iclnuim.blender import surfaces

    meshes = [o for o in bpy.context.scene.objects if o.type == "MESH"]
    objects = {o.name: (o["instance_id"], o["class_name"]) for o in meshes}
    found = surfaces.triangles()
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(found.vertices.astype(np.float32), found.triangles.astype(np.uint32))
    return Office(objects, found, stage.geometry_hash(), stage.triangle_count(), caster)


def built(seed=0, detail=1.0):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build_scene("office", seed, detail)
    return captured()


@pytest.fixture(scope="module")
def office(small_textures):
    return built()


@pytest.fixture
def opened(repository):
    """The shipped file, open in this session."""
    bpy.ops.wm.open_mainfile(filepath=str(repository / "blend/office.blend"), use_scripts=False)
    return captured()


@pytest.fixture(scope="module")
def rng_directions():
    d = np.random.default_rng(4).normal(size=(200_000, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def test_the_office_stays_within_its_means(office):
    assert 100_000 < office.triangles <= 200_000


def test_the_same_seed_gives_the_same_office_and_another_seed_another():
    first = built(3, 0.15)
    again = built(3, 0.15)
    other = built(4, 0.15)
    assert first.sha256 == again.sha256 != other.sha256
    assert first.objects.keys() == other.objects.keys()
    assert first.triangles < 135_000


def test_every_thing_of_the_office_has_a_stable_number_and_a_class(office):
    assert sorted(number for number, _ in office.objects.values()) == list(
        range(1, len(office.objects) + 1)
    )
    assert {name for _, name in office.objects.values()} >= LISTED


def test_the_office_file_holds_what_the_code_builds_and_is_small(office, opened, repository):
    assert opened.sha256 == office.sha256
    assert opened.objects == office.objects
    assert (repository / "blend/office.blend").stat().st_size < 8e6
    images = [i for i in bpy.data.images if i.users and i.type == "IMAGE"]
    assert len(images) > 10
    assert [i.name for i in images if not i.packed_file] == []
    assert len(bpy.data.texts) == 0 == len(bpy.data.libraries)
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            assert thing.pass_index == thing["instance_id"]
            assert np.allclose(thing.matrix_world, np.eye(4))
            assert not thing.modifiers


def test_the_offices_meshes_are_valid(opened):
    for mesh in bpy.data.meshes:
        area = np.empty(len(mesh.polygons))
        mesh.polygons.foreach_get("area", area)
        assert area.min() > 1e-9, mesh.name
        assert not mesh.validate(), mesh.name
        assert "UVMap" in mesh.uv_layers, mesh.name


def test_the_offices_materials_keep_the_forms_that_baking_understands(opened):
    for material in bpy.data.materials:
        kinds = {n.type for n in material.node_tree.nodes}
        assert kinds <= OPAQUE, material.name
        if "EMISSION" in kinds:
            assert material.cycles.emission_sampling == "NONE"


def test_the_offices_surfaces_turn_their_front_to_the_room(office, rng_directions):
    for eye in ((0.0, 0.5, 4.5), (-1.0, -1.2, 4.3), (0.9, 2.2, 4.6), (-0.2, -2.2, 4.6)):
        _, owner, facing = office.cast(np.array(eye), rng_directions)
        assert (owner >= 0).mean() > 0.9999
        names = np.array(office.surface.names)[owner[owner >= 0]]
        wrong = names[facing[owner >= 0] > 1e-3]
        assert len(wrong) <= 2e-5 * len(names), set(
            wrong
        )  # a ray through an edge may meet the inside


def test_no_two_things_of_the_office_share_a_visible_surface(office, rng_directions):
    """A second object within 20 micrometres behind the first would flicker."""
    for eye in ((0.2, 0.9, 4.6), (0.0, -1.8, 4.6)):
        distance, owner, _ = office.cast(np.array(eye), rng_directions)
        seen = owner >= 0
        start = np.array(eye) + rng_directions[seen] * (distance[seen, None] - 2e-5)
        lines = np.concatenate([start, rng_directions[seen]], -1).astype(np.float32)
        hits = office.caster.list_intersections(lines)
        near = hits["t_hit"].numpy() < 4e-5
        ray = hits["ray_ids"].numpy()[near].astype(int)
        owners = office.surface.owners[hits["primitive_ids"].numpy()[near]]
        first = np.full(len(start), -1)
        first[ray[::-1]] = owners[::-1]
        shared = owners != first[ray]
        pairs = {
            (office.surface.names[a], office.surface.names[b])
            for a, b in zip(owners[shared], first[ray][shared], strict=True)
        }
        assert shared.sum() <= 1e-4 * len(start), pairs


@pytest.mark.parametrize("kt", ["kt0", "kt1", "kt2", "kt3"])
def test_our_office_paths_keep_25_cm_from_every_surface(office, repository, kt):
    positions_m = read_trajectory(
        repository / f"trajectories/office/{kt}.txt"
    ).trajectory.positions_m
    closest = office.caster.compute_closest_points(positions_m.astype(np.float32))
    distance = np.linalg.norm(closest["points"].numpy() - positions_m, axis=1)
    names = np.array(office.surface.names)[office.surface.owners[closest["primitive_ids"].numpy()]]
    least = np.where((kt == "kt0") & np.isin(names, CEILING), 0.10, 0.25)
    worst = (distance - least).argmin()
    assert distance[worst] > least[worst], (int(worst), positions_m[worst], names[worst])


def test_the_offices_ceiling_is_as_flat_as_the_originals(office):
    """Official depth has the light of the luminaires flush with the panels, and nothing lower than
    10.3 mm: with more relief, the noise model spoils the depth of all corners there.
    """
    names = [name for name in office.objects if name.startswith(("ceiling", "luminaire", "vent"))]
    heights = {}
    for k, name in enumerate(office.surface.names):
        if name in names:
            heights[name] = office.surface.vertices[
                office.surface.triangles[office.surface.owners == k].ravel(), 2
            ]
    assert len(heights) == len(names) == 16
    below_m = {name: 5.4 - z for name, z in heights.items()}
    for below in below_m.values():  # flanks end above the panels
        assert below.min() > -0.0062 and below.max() < 0.0103
    assert max(below_m["ceiling_rails"]) < 0.0012


def test_the_carpet_keeps_its_contrast_where_a_pixel_covers_4_mm():
    """Its finest contrast was measured in official frames; mipmaps average 4 x 4 texels there."""
    carpet = office_textures.carpet(np.random.default_rng(0), 2048, (0.31, 0.305, 0.298))[
        ..., 1
    ].astype(np.float32)
    seen = cv2.resize(carpet, (512, 512), interpolation=cv2.INTER_AREA)
    finest = (seen - cv2.GaussianBlur(seen, (0, 0), 0.7)).std() / seen.mean()
    assert 0.06 < finest < 0.085


def test_the_official_path_passes_12_cm_under_the_ceiling_and_touches_nothing(samples, office):
    positions_m = OFFICE.poses(samples).translation
    distance = office.caster.compute_distance(positions_m.astype(np.float32)).numpy()
    assert 0.10 < distance.min() < 0.14
    assert positions_m[distance.argmin(), 2] == pytest.approx(positions_m[:, 2].max(), abs=0.01)
    steps = np.diff(positions_m, axis=0)
    hit, _, _ = office.cast(positions_m[:-1], steps)  # in steps: nothing lies between two poses
    assert (hit > 1).all()
    lateral = (positions_m[:, 2] < 5.15) & (positions_m[:, 2] > 3.2)
    assert distance[lateral].min() > 0.20


@pytest.mark.parametrize("number", OFFICE.frames)
def test_bare_floor_ceiling_and_walls_of_the_office_agree_with_official_depth_to_2_cm(
    samples, office, number
):
    _, truth = OFFICE.official(samples, number)
    T = OFFICE.poses(samples)[number]
    depth, owner, _ = office.cast(
        T.translation, PinholeCamera().rays().reshape(480, 640, 3) @ T.rotation.T
    )
    bare = []
    for i, n in enumerate(office.surface.names):
        if n.startswith("wall_") or n in ("floor", "ceiling"):
            bare.append(i)
    plane = np.isin(owner, bare) & (truth > 0)
    error = np.abs(depth - truth)[plane]
    assert plane.mean() > 0.5
    assert (error < 0.02).mean() > 0.95, (error < 0.02).mean()
    assert np.median(error) < 0.005


@pytest.mark.parametrize("number", OFFICE.frames)
def test_most_of_each_official_office_frame_lies_within_3_cm(samples, office, number):
    _, truth = OFFICE.official(samples, number)
    T = OFFICE.poses(samples)[number]
    depth, _, _ = office.cast(
        T.translation, PinholeCamera().rays().reshape(480, 640, 3) @ T.rotation.T
    )
    assert (np.abs(depth - truth)[truth > 0] < 0.03).mean() > 0.85


def test_the_page_of_facts_lists_everything_in_the_office(office, repository):
    text = (repository / "blend/README.md").read_text()
    text = text[text.index("## The office") :]
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (\w+) \|", text, re.M)
    listed = {name: (int(number), kind) for number, name, kind in rows}
    assert listed == office.objects
    assert f"{office.triangles:,}" in text
