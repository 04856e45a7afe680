"""Own scenes rendered as a user would: depth against Embree, Principled surfaces against a white
furnace, crashes in words.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from judges import judge_module
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[2]


def iclnuim(*arguments):
    """The command in a process of its own, as a user runs it."""
    command = [sys.executable, "-m", "iclnuim", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=patience(300))


def rich_room(folder: Path) -> Path:
    """The small room with what exporters and importers trip over: a modifier, a mirrored twin,
    instances, a displaced sheet.
    """
    made.small_room(bpy, folder)
    crate = bpy.data.objects["crate"]
    crate.modifiers.new("round", "BEVEL").width = 0.05
    twin = bpy.data.objects.new("twin", crate.data)
    twin.scale = (-1, 1, 1.2)
    twin.location = (2.2, -0.4, 0)
    bpy.context.scene.collection.objects.link(twin)
    many = bpy.data.collections.new("many")
    pin = made.box(bpy, "pin", (-0.05, -0.05, 0), (0.05, 0.05, 0.6), made.material(bpy, "pin"))
    bpy.context.scene.collection.objects.unlink(pin)
    many.objects.link(pin)
    for k in range(3):
        place = bpy.data.objects.new(f"place{k}", None)
        place.instance_type = "COLLECTION"
        place.instance_collection = many
        place.location = (-2 + 0.3 * k, 1.7, 0)
        place.rotation_euler = (0.2 * k, 0, k)
        bpy.context.scene.collection.objects.link(place)
    n = 24
    grid = []
    for j in range(n):
        for i in range(n):
            grid.append((0.06 * i - 0.7, 0.06 * j - 0.7, 0.0))
    quads = []
    for j in range(n - 1):
        for i in range(n - 1):
            quads.append((j * n + i, j * n + i + 1, j * n + n + i + 1, j * n + n + i))
    waves = made.material(bpy, "waves")
    tree = waves.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    lift = tree.nodes.new("ShaderNodeDisplacement")
    lift.inputs["Scale"].default_value = 0.25
    tree.links.new(noise.outputs[0], lift.inputs["Height"])
    tree.links.new(lift.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    waves.displacement_method = "DISPLACEMENT"
    sheet = made.add(bpy, "sheet", grid, quads, waves, uv=False)
    sheet.location = (1.6, 1.2, 1.2)
    sheet.rotation_euler = (1.0, 0, 0)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"))
    return folder / "room.blend"


@pytest.fixture(scope="module")
def rich(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rich")
    files = {"blend": rich_room(folder)}
    for kind in ("glb", "obj"):
        bpy.ops.wm.open_mainfile(filepath=str(files["blend"]))
        files[kind] = files["blend"].with_suffix(f".{kind}")
        made.EXPORTS[kind](bpy, str(files[kind]))
    return files


@pytest.fixture(scope="module")
def camera_path(rich, tmp_path_factory):
    """The animation of the .blend's camera, as the command saves it."""
    out = tmp_path_factory.mktemp("camera") / "path.txt"
    done = iclnuim("trajectory", "camera", rich["blend"], "-o", out)
    assert done.returncode == 0, done.stderr
    return out


def test_the_cameras_animation_is_saved_as_it_plays(camera_path):
    rows = np.loadtxt(camera_path)
    assert rows.shape == (5, 8)
    assert rows[:, 0] == pytest.approx(1 + np.arange(5) / 24, abs=1e-6)
    assert rows[0, 1:4] == pytest.approx([-0.5, -1.8, 1.4], abs=1e-6)
    assert rows[-1, 1:4] == pytest.approx([0.5, -1.8, 1.4], abs=1e-6)
    from iclnuim.geometry.se3 import SE3

    looks = SE3.from_quat_xyzw(rows[:, 4:], rows[:, 1:4]).rotation[:, :, 2]
    assert looks == pytest.approx(
        np.tile([0, np.sin(np.radians(80)), -np.cos(np.radians(80))], (5, 1)), abs=1e-6
    )


@pytest.mark.parametrize("kind", ["blend", "glb", "obj"])
def test_depth_of_an_imported_scene_is_that_of_rays_cast_by_embree(
    rich, camera_path, tmp_path, kind, command_here, render_here
):
    """One kind by the command, the others in this process."""
    pytest.importorskip("embreex")
    out = tmp_path / "run"
    if kind == "obj":
        light = ("--light", "path", "--samples", "1", "--no-denoise")
        place = ("--scene", rich[kind], "--trajectory", camera_path, "--out", out)
        render = iclnuim("render", *place, "--camera", "160x120", *light)
        assert render.returncode == 0, render.stderr
    else:
        render_here(out, scene=rich[kind], trajectory=camera_path, camera="160x120", samples=1)
    code, printed, said = command_here("check-depth", out, "--json")
    assert code == 0, printed + said
    figures = json.loads(printed)
    assert figures["pixels"] == 5 * 160 * 120
    assert figures["edge_share"] < 0.05
    assert figures["max_m"] < 1e-4
    assert figures["one_sided_share"] == 0


@pytest.mark.parametrize(
    "settings", [{}, {"Roughness": 0.9}, {"Roughness": 0.1, "IOR": 1.8}, {"Metallic": 0.4}]
)
def test_a_white_principled_ball_cannot_be_told_from_a_white_furnace(tmp_path, settings):
    """Irradiance 1 in the map, radiance 1 around: what the diffuse share lacks the gloss must give,
    at every angle.
    """
    from iclnuim.blender import compat
    from iclnuim.blender.light import baked_material

    scene = made.fresh(bpy)
    world = bpy.data.worlds.new("white")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    scene.world = world
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64)
    ball = bpy.context.object
    bpy.ops.object.shade_smooth()
    ball.data.uv_layers.new(name=baked_material.FRONT_UV)
    light = bpy.data.images.new("light", 4, 4, float_buffer=True, is_data=True)
    light.pixels.foreach_set(np.ones(64, np.float32))
    white = made.material(bpy, "white", (1, 1, 1), **settings)
    ball.data.materials.append(
        baked_material.baked_copy(white, baked_material.BakedLight(light, False))
    )
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 2.0
    camera.location = (0, 0, 5)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 64
    scene.cycles.use_denoising = False
    scene.cycles.filter_width = 0.01
    scene.render.resolution_x = scene.render.resolution_y = 48
    compat.set_multilayer_exr(scene.render.image_settings)
    scene.render.filepath = str(tmp_path / "ball.exr")
    bpy.ops.render.render(write_still=True)
    from iclnuim.formats.exr import read_exr

    channels = read_exr(tmp_path / "ball.exr")
    red = next(v for k, v in channels.items() if k.endswith("Combined.R"))
    y, x = (np.mgrid[:48, :48] + 0.5) / 24 - 1
    cosine = np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))
    seen = red[cosine > 0.2]
    assert abs(seen.mean() - 1) < 0.01
    assert np.abs(seen - 1).max() < 0.06


@pytest.mark.slow
def test_light_baked_on_an_own_scene_is_near_path_tracing(
    rich, camera_path, tmp_path, render_here, monkeypatch
):
    """A coarse map on a small picture; the page on own scenes has the figures of a fine one."""
    from iclnuim.formats.exr import read_exr
    from iclnuim.sensor.transfer import srgb_from_light

    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    ways = {
        "baked": {"light": "baked", "map_size": 192, "map_samples": 16, "samples": 16},
        "path": {"light": "path", "samples": 96},
    }
    pictures = {}
    for name, way in ways.items():
        fixed = {
            "scene": rich["glb"],
            "trajectory": camera_path,
            "camera": "48x36",
            "denoise": False,
            "antialias": True,
        }
        render_here(tmp_path / name, "2", **fixed, **way)
        channels = read_exr(tmp_path / name / "exr/000002.exr")
        pictures[name] = srgb_from_light(np.stack([channels[c] for c in "RGB"], -1).astype(float))
    error = np.abs(pictures["baked"] - pictures["path"])
    assert np.median(error) < 0.02
    assert abs((pictures["baked"] - pictures["path"]).mean()) < 0.015


def test_a_walk_through_an_own_scene_is_clear_of_its_surfaces(rich, tmp_path, command_here):
    open3d = judge_module("open3d", "open3d-cpu")
    ends = ("-1.9,-1.5,1.2:0,1,1", "1.6,0.2,1.1")
    place = ("--scene", rich["obj"], "--viewpoints")
    code, printed, said = command_here(
        "trajectory", "make", *place, *ends, "--out", tmp_path, "--json"
    )
    assert code == 0, said
    figures = json.loads(printed)
    poses = np.loadtxt(tmp_path / "room.txt")
    assert poses[0, 1:4] == pytest.approx([-1.9, -1.5, 1.2], abs=0.04)
    assert poses[-1, 1:4] == pytest.approx([1.6, 0.2, 1.1], abs=0.04)
    from iclnuim.blender import surfaces
    from iclnuim.blender.open import scene

    scene.open_scene(str(rich["obj"]))
    found = surfaces.triangles()
    judge = open3d.t.geometry.RaycastingScene()
    tensor = open3d.core.Tensor
    judge.add_triangles(
        tensor(found.vertices.astype(np.float32)), tensor(found.triangles.astype(np.uint32))
    )
    between = np.concatenate([poses[:, 1:4], (poses[1:, 1:4] + poses[:-1, 1:4]) / 2]).astype(
        np.float32
    )
    assert judge.compute_distance(tensor(between)).numpy().min() > 0.245
    assert figures["clearance_m"] >= 0.25
    again = iclnuim("trajectory", "make", tmp_path / "room.json", "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again/room.txt").read_bytes() == (tmp_path / "room.txt").read_bytes()
    code, _, said = command_here("trajectory", "make", *place, "0.6,0.9,0.8", "0,0,1")
    assert code == 2
    assert "0.25 m from every surface" in said


def test_a_crash_of_blender_becomes_words():
    program = (
        "import os, signal, sys\n"
        "from iclnuim.headless.isolation import run_isolated\n"
        "from iclnuim.errors import InputError, WorkError\n"
        "def crash(): os.kill(os.getpid(), signal.SIGSEGV)\n"
        "def refuse(): raise InputError('a scene', path='b.obj')\n"
        "assert run_isolated(lambda: 3, 'a.obj') == 3\n"
        "for work in (crash, refuse):\n"
        "    try: run_isolated(work, 'a.blend')\n"
        "    except Exception as error: print(error.exit_code, error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=patience(60)
    )
    first, second = done.stdout.splitlines()
    assert first.startswith("3 a.blend: Blender crashed on it (SIGSEGV)")
    assert second == "2 b.obj: expected a scene"
