"""Instances, classes and normals against rays cast by Embree, in a scene made to be awkward and in
the shipped ones.
"""

import csv
import json
import subprocess
import sys

import bpy
import numpy as np
import pytest
from iclnuim.blender.render import ground_truth as classes
from iclnuim.channels import CHANNELS, FURTHER, normal16
from iclnuim.formats.exr import read_exr
from iclnuim.formats.png import read_depth16, read_rgb16
from iclnuim.sensor.models import depth_model, rgb_model
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.run_folder import read_run
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import read_trajectory
from judges import judge_module
from patience import patience

o3d = judge_module("open3d", "open3d-cpu")


def mesh_object(name, mesh, location=(0, 0, 0), **properties):
    thing = bpy.data.objects.new(name, mesh)
    thing.location = location
    for key, value in properties.items():
        thing[key] = value
    bpy.context.scene.collection.objects.link(thing)
    return thing


def polished():
    """Principled, shiny: its Normal pass bends towards the viewer at grazing angles."""
    material = bpy.data.materials.new("polished")
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.05
    return material


def normal_from16(image):
    """As docs/guide/ground_truth.md has it: (h, w, 3), of unit length or zero."""
    normal = np.where(image.any(-1, keepdims=True), (image.astype(float) - 32768) / 32767, 0.0)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal / np.where(length > 0, length, 1.0)


@pytest.fixture(scope="module")
def awkward_scene(tmp_path_factory):
    """A floor without material, a smooth polished ball with an id of its own, a single sheet seen
    from behind, a tilted and stretched box twice by instancing.
    """
    import bmesh

    path = tmp_path_factory.mktemp("awkward") / "awkward.blend"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    floor = bpy.data.meshes.new("floor")
    floor.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    mesh_object("floor", floor, class_name="floor")
    ball = bpy.data.meshes.new("ball")
    work = bmesh.new()
    bmesh.ops.create_uvsphere(work, u_segments=24, v_segments=12, radius=0.5)
    work.to_mesh(ball)
    ball.polygons.foreach_set("use_smooth", np.ones(len(ball.polygons), bool))
    ball.materials.append(polished())
    mesh_object("ball", ball, (-0.6, 0.6, 0.6), class_name="gnome", instance_id=1)
    sheet = bpy.data.meshes.new("sheet")
    sheet.from_pydata(
        [(0.2, 1.6, 0.2), (0.9, 1.6, 0.2), (0.9, 1.6, 1.2), (0.2, 1.6, 1.2)], [], [(0, 1, 2, 3)]
    )
    sheet.flip_normals()
    mesh_object("sheet", sheet)
    box = bpy.data.meshes.new("box")
    work = bmesh.new()
    bmesh.ops.create_cube(work, size=0.5)
    work.to_mesh(box)
    crate = bpy.data.objects.new("crate", box)
    crate.rotation_euler = (0.2, 0.1, 0.7)
    crate.scale = (1.0, 0.6, 0.4)
    crate["class_name"] = "box"
    shelf = bpy.data.collections.new("shelf")
    shelf.objects.link(crate)
    for x in (0.1, 0.9):
        place = bpy.data.objects.new(f"place {x}", None)
        place.instance_type = "COLLECTION"
        place.instance_collection = shelf
        place.location = (x, 0.3, 0.4)
        bpy.context.scene.collection.objects.link(place)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    lamp.location = (0, 0, 2.5)
    lamp.data.energy = 100.0
    bpy.context.scene.collection.objects.link(lamp)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def judge_of_open_scene():
    """Embree on the open scene: whose surface a pixel's centre sees, and its interpolated normal in
    the camera's frame.
    """
    from iclnuim.blender.render import model
    from iclnuim.raycast.depth_check import TruthCaster

    return TruthCaster(model.scene_model())


def angle_deg(a, b):
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2, 0, 1)))


def normals_of(frame):
    return np.stack([frame[f"normal.{axis}"] for axis in "XYZ"], -1)


@pytest.fixture(scope="module")
def truth_run(render_here, awkward_scene, tmp_path_factory):
    out = tmp_path_factory.mktemp("truth") / "run"
    render_here(out, "::6", scene=awkward_scene, camera="160x120", samples=1, ground_truth=True)
    return out


def test_instances_and_normals_are_those_of_rays_through_the_pixel_centres(
    truth_run, awkward_scene
):
    from iclnuim.blender.open import scene

    scene.open_scene(str(awkward_scene))
    judge = judge_of_open_scene()
    run = read_run(truth_run)
    poses = read_trajectory(truth_run / "groundtruth.txt", "tum").trajectory.T_world_camera
    for number in (0, 6):
        frame = read_exr(run.frame_file(number))
        z, ids, normals = judge.frame(run.camera, poses[number])
        seen = z > 0
        same_place = seen & (np.abs(frame["Z"] - z) < 1e-4)  # an outline may fall to either side
        assert same_place[seen].mean() > 0.999
        assert (frame["instance"][seen] == ids[seen]).mean() > 0.999
        assert np.array_equal(frame["instance"] == 0, frame["Z"] == 0)
        assert len(np.unique(ids[seen])) == 4
        off = angle_deg(normals_of(frame), normals)[same_place]
        assert np.quantile(off, 0.999) < 0.1
        facing = (normals_of(frame) * run.camera.rays()).sum(-1)[same_place]
        assert (facing < 0.3).all()  # they face the viewer, up to smooth shading


def test_baked_light_shows_the_same_truth_as_path_tracing(
    render_here, truth_run, awkward_scene, tmp_path, monkeypatch
):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    light = {"light": "baked", "map_size": 64, "map_samples": 2}
    render_here(
        tmp_path / "baked", "6", scene=awkward_scene, camera="160x120", ground_truth=True, **light
    )
    baked, traced = (read_exr(p / "exr/000006.exr") for p in (tmp_path / "baked", truth_run))
    assert np.array_equal(baked["instance"], traced["instance"])
    assert angle_deg(normals_of(baked), normals_of(traced)).max() < 0.01
    tables = [json.loads((p / "objects.json").read_text()) for p in (tmp_path / "baked", truth_run)]
    assert tables[0] == tables[1]


def test_check_depth_judges_the_truth_too_and_notices_a_wrong_normal(
    truth_run, tmp_path, command_here
):
    import shutil

    from iclnuim.formats.exr import exr_header, write_exr

    _, printed, _ = command_here("check-depth", "--json", "--quiet", truth_run)
    figures = json.loads(printed)
    assert figures["equal_instance_share"] > 0.999 and figures["normal_within_share"] > 0.999
    turned = tmp_path / "turned"
    shutil.copytree(truth_run, turned)
    for path in sorted((turned / "exr").glob("*.exr")):
        channels = read_exr(path)
        channels["normal.X"], channels["normal.Y"] = channels["normal.Y"], channels["normal.X"]
        write_exr(path, channels, attributes=exr_header(path).parts[0].attributes)
    code, printed, _ = command_here("check-depth", "--json", "--quiet", turned)
    assert code == 3 and json.loads(printed)["normal_within_share"] < 0.9


def test_the_table_names_every_object_with_pose_boxes_class_and_nyu40_label(truth_run):
    table = json.loads((truth_run / "objects.json").read_text())
    rows = {row["name"]: row for row in table["objects"]}
    assert (
        rows["ball"]["id"] == 1
        and rows["ball"]["class_id"] == classes.FIRST_OWN
        and rows["ball"]["nyu40_id"] == 0
    )
    assert (
        rows["floor"]["nyu40_id"] == 2
        and rows["crate"]["nyu40_id"] == 29
        and rows["sheet"]["class_id"] == 0
    )
    crates = [row for row in table["objects"] if row["name"] == "crate"]
    assert len(crates) == 2 and crates[0]["id"] == crates[1]["id"]
    assert len({row["id"] for row in table["objects"]}) == 4
    for row in table["objects"]:
        low, high = (np.array(row["box_world_m"][k]) for k in ("min", "max"))
        centre = np.array(row["box_m"]["centre"])
        size = np.array(row["box_m"]["size"])
        assert np.all(np.abs(centre - (low + high) / 2) < 1e-5 + (high - low) * 0.2)
        assert np.linalg.norm(size) <= np.linalg.norm(high - low) + 1e-5
    T = np.array(rows["ball"]["T_world_object"])
    assert T[:3, 3] == pytest.approx([-0.6, 0.6, 0.6])


def test_colour_and_depth_keep_their_bits_and_many_samples_do_not_blend_the_truth(
    render_here, truth_run, awkward_scene, tmp_path
):
    small = {"scene": awkward_scene, "camera": "160x120"}
    render_here(tmp_path / "plain", "6", **small, samples=1)
    render_here(tmp_path / "many", "6", **small, samples=4, antialias=True, ground_truth=True)
    runs = (truth_run, tmp_path / "plain", tmp_path / "many")
    truth, plain, many = (read_exr(run / "exr/000006.exr") for run in runs)
    assert set(plain) == set("RGBZ")
    assert all(np.array_equal(plain[c], truth[c]) for c in "RGBZ")
    assert all(np.array_equal(many[c], truth[c]) for c in set(truth) - set("RGB"))
    assert "ground_truth" not in json.loads((tmp_path / "plain/sequence.json").read_text())["job"]


def test_a_sequence_holds_the_truth_beside_rgb_and_depth_in_every_format(truth_run, tmp_path):
    command = [
        sys.executable,
        "-m",
        "iclnuim",
        "dataset",
        str(truth_run),
        str(tmp_path / "out"),
        "--quiet",
    ]
    for form in ("tum", "euroc"):
        command += ["--format", form]
    subprocess.run(command, check=True, timeout=patience(120))
    tum = tmp_path / "out/tum"
    euroc = tmp_path / "out/euroc"
    frame = read_exr(truth_run / "exr/000006.exr")
    instance, kind = (read_depth16(tum / f"{name}/000006.png") for name in ("instance", "class"))
    assert np.array_equal(instance, frame["instance"].astype(int))
    assert (
        angle_deg(normal_from16(read_rgb16(tum / "normal/000006.png")), normals_of(frame)).max()
        < 0.002
    )
    rows = json.loads((tum / "objects.json").read_text())["objects"]
    for row in rows:
        assert (kind[instance == row["id"]] == row["class_id"]).all()
    with open(tum / "classes.csv", encoding="utf-8") as file:
        listed = {int(row["class_id"]): row["nyu40"] for row in csv.DictReader(file)}
    assert {row["class_id"] for row in rows} == set(listed)
    assert listed[classes.KINDS["floor"].id] == "floor"
    for name in ("instance", "class", "normal"):
        mine = euroc / f"mav0/{name}0/data/{200_000_000:019}.png"
        assert mine.read_bytes() == (tum / f"{name}/000006.png").read_bytes()
    again = subprocess.run(
        [*command[:-5], *command[-4:]],
        capture_output=True,
        text=True,
        check=True,
        timeout=patience(120),
    )
    assert "0 frames written, 2 already finished" in again.stdout


def test_one_channel_is_written_without_the_others(render_here, truth_run, awkward_scene, tmp_path):
    render_here(
        tmp_path / "run",
        "6",
        scene=awkward_scene,
        camera="160x120",
        samples=1,
        channels=("normal",),
    )
    alone, truth = (read_exr(p / "exr/000006.exr") for p in (tmp_path / "run", truth_run))
    assert set(truth) - set(alone) == {"instance"}
    assert all(np.array_equal(alone[name], truth[name]) for name in alone)
    write_sequence(run_frames(tmp_path / "run"), tmp_path / "out")
    assert (tmp_path / "out/normal/000006.png").is_file()
    missing = ("instance", "class", "objects.json", "classes.csv")
    assert not any((tmp_path / "out" / name).exists() for name in missing)
    assert not (tmp_path / "run/objects.json").exists()


@pytest.mark.slow
def test_the_estimated_bytes_of_images_are_those_of_a_room(repository, tmp_path):
    """Of one frame of the size that the bytes are given for, with and without noise."""
    words = ["render", "kt2", "--frames", "480:481", "--ground-truth", "-o", str(tmp_path / "run")]
    subprocess.run([sys.executable, "-m", "iclnuim", *words], check=True, timeout=patience(120))
    noise = SequenceSettings(depth_model("released"), rgb_model("released"))
    for name, settings in (("clean", SequenceSettings()), ("noisy", noise)):
        write_sequence(run_frames(tmp_path / "run"), tmp_path / name, settings)
    for name, channel in CHANNELS.items():
        sizes = [p.stat().st_size for p in tmp_path.glob(f"[cn]*/{name}/*.png")]
        assert len(sizes) == 2
        assert 0.6 < np.mean(sizes) / (640 * 480) / channel.png_bytes < 1.6


@pytest.mark.parametrize("room, pose", [("living_room", "kt2"), ("office", "kt3")])
def test_the_shipped_rooms_put_out_the_normals_and_instances_that_rays_meet(
    room, pose, repository, tmp_path
):
    from iclnuim.blender.open import scene
    from iclnuim.blender.render import camera, frames, passes, settings
    from iclnuim.geometry.camera import PinholeCamera
    from iclnuim.job import RenderJob

    scene.open_scene(room)
    judge = judge_of_open_scene()
    job = RenderJob(
        "x",
        room,
        "x",
        camera=PinholeCamera.parse("320x240"),
        light="path",
        samples=1,
        denoise=False,
    )
    settings.apply(job)
    passes.add(FURTHER.values())
    trajectory = read_trajectory(repository / f"trajectories/{room}/{pose}.txt").trajectory
    poses = trajectory.T_world_camera
    camera.keyframe(poses, job.camera)
    number = len(poses) // 2
    frames.render(number, tmp_path / "f.exr")
    raw = frames.channels_of(tmp_path / "f.exr")
    depth_z_m = frames.read(raw, raw)[1]
    shot = passes.Shot(raw, depth_z_m, number, trajectory, job.camera)
    found = passes.read(shot, FURTHER.values())
    z, ids, normals = judge.frame(job.camera, poses[number])
    seen = z > 0
    same_place = seen & (np.abs(depth_z_m - z) < 1e-4)
    assert same_place.mean() > 0.998
    assert (found["instance"] == ids)[same_place].mean() > 0.9999
    assert (angle_deg(normals_of(found), normals)[same_place] < 0.1).mean() > 0.9998
    names = {o.pass_index: o["class_name"] for o in bpy.context.scene.objects if o.type == "MESH"}
    assert all(names[i] in classes.KINDS for i in np.unique(found["instance"]) if i)


def test_normals_survive_sixteen_bits_to_a_five_hundredth_of_a_degree():
    normal = np.random.default_rng(5).normal(size=(100, 100, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[0, 0] = 0
    back = normal_from16(normal16(normal))
    assert (back[0, 0] == 0).all()
    assert angle_deg(back, normal).max() < 0.002


def test_every_class_of_the_shipped_rooms_has_a_number_and_a_label(repository):
    text = (repository / "blend/README.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| ") and "`" in line]
    listed = {row.split("|")[3].strip() for row in rows}
    listed = {name for name in listed if name.isidentifier()}
    assert len(listed) > 30 and listed <= set(classes.KINDS)
    numbers = [kind.id for kind in classes.KINDS.values()]
    assert len(set(numbers)) == len(numbers) and max(numbers) < classes.FIRST_OWN
    assert len(classes.NYU40) == 40 == len(set(classes.NYU40))


def test_depth_where_a_pane_is_seen_is_its_own_none_or_that_of_what_stands_behind(
    render_here, cornered_room, forward_path, tmp_path, capsys
):
    """A pane y = 1 before half of the wall; colour, instances and check-depth are told what was
    asked for.
    """
    from iclnuim.headless.cli import main

    bpy.ops.wm.open_mainfile(filepath=str(cornered_room))
    glass = bpy.data.materials.new("glass")
    glass.use_nodes = True
    nodes = glass.node_tree.nodes
    links = glass.node_tree.links
    clear = nodes.new("ShaderNodeBsdfTransparent")
    output = glass.node_tree.get_output_node("CYCLES")
    links.new(clear.outputs[0], output.inputs["Surface"])
    pane = bpy.data.meshes.new("pane")
    pane.from_pydata(
        [(-9, -0.5, 0.1), (0, -0.5, 0.1), (0, -0.5, 3), (-9, -0.5, 3)], [], [(0, 1, 2, 3)]
    )
    pane.materials.append(glass)
    mesh_object("pane", pane)
    scene = tmp_path / "glazed.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    frames = {}
    for kind in ("surface", "none", "behind"):
        render_here(tmp_path / kind, "3", scene=scene, samples=1, ground_truth=True, glass=kind)
        frames[kind] = read_exr(tmp_path / kind / "exr/000003.exr")
        assert main(["check-depth", "--quiet", str(tmp_path / kind)]) == 0, capsys.readouterr()
        recipe = json.loads((tmp_path / kind / "sequence.json").read_text())["job"]
        assert recipe.get("glass", "surface") == kind
        for channel in ("R", "G", "B", "instance"):
            assert np.array_equal(frames[kind][channel], frames["surface"][channel])
    render_here(tmp_path / "open", "3", samples=1)
    clear_z_m = read_exr(tmp_path / "open/exr/000003.exr")["Z"]
    (pane_z_m, none_z_m, behind_z_m) = (f["Z"] for f in frames.values())
    glazed = pane_z_m != clear_z_m
    assert 0.3 < glazed.mean() < 0.7
    assert np.array_equal(none_z_m, np.where(glazed, 0, clear_z_m))
    assert np.array_equal(behind_z_m, clear_z_m)


def test_instances_hidden_in_the_viewport_alone_have_numbers():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("tile")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    assets = bpy.data.collections.new("assets")
    asset = bpy.data.objects.new("asset", mesh)
    assets.objects.link(asset)
    shown = bpy.data.objects.new("shown", None)
    shown.instance_type = "COLLECTION"
    shown.instance_collection = assets
    shown.hide_viewport = True
    bpy.context.scene.collection.objects.link(shown)
    classes.number_objects()
    assert asset.pass_index == 1
