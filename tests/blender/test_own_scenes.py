"""Scenes of one's own: what every format gives, how axes and units are told, what is mended, and
what is refused.
"""

import json
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender import compat, surfaces  # noqa: E402
from iclnuim.blender.open import (  # noqa: E402
    displacement,
    faces,
    light_choice,
    motion,
    preflight,
    scene,
)
from iclnuim.blender.render import camera  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.geometry import scene_axes  # noqa: E402
from iclnuim.geometry.scene_axes import SceneReading  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return made.small_room(bpy, tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="module")
def exported(room):
    """Kind -> file; the .blend is open when each is written."""
    files = {"blend": room}
    for kind, export in made.EXPORTS.items():
        bpy.ops.wm.open_mainfile(filepath=str(room))
        files[kind] = room.with_suffix(f".{kind}")
        export(bpy, str(files[kind]))
    return files


@pytest.fixture(scope="module")
def points(room):
    scene.open_scene(str(room))
    return made.points_of(surfaces.triangles())


def opened(path, **reading):
    return scene.open_scene(str(path), SceneReading(**reading))


@pytest.mark.parametrize("kind", made.EXPORTS)
def test_every_format_gives_the_surface_that_was_exported(exported, points, kind):
    opened(exported[kind])
    assert np.allclose(made.points_of(surfaces.triangles()), points, atol=2e-4)


def test_a_format_that_says_nothing_has_its_guess_told(exported):
    assert any("y up, metres; a guess" in note for note in opened(exported["obj"]))
    assert not any("guess" in note for note in opened(exported["glb"]))


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ({}, "its up axis and unit (options: up and scene unit)"),
        ({"up": "y"}, "its unit (options: scene unit)"),
        ({"unit_m": 1.0}, "its up axis (options: up)"),
    ],
)
def test_what_is_guessed_is_what_the_format_does_not_contain(exported, known, words):
    assert f"does not contain {words}" in "".join(opened(exported["obj"], **known))


@pytest.mark.parametrize(
    ("kind", "size", "said"),
    [
        (
            "obj",
            (140, 90, 3),
            "140 x 90 m, 3 m high is not the size of a room, no other unit makes it one",
        ),
        (
            "usda",
            (500, 400, 250),
            "500 x 400 m, 250 m high is not the size of a room, as centimetres it would be one",
        ),
        ("obj", (50, 40, 26), "decimetres"),
        ("usda", (5, 4, 2.5), None),
    ],
)
def test_a_size_of_no_room_gets_a_word(tmp_path, kind, size, said):
    corners = []
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                corners.append((x * size[0], y * size[1], z * size[2]))
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    texts = {
        "obj": "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        + "".join("f " + " ".join(str(k + 1) for k in face) + "\n" for face in faces),
        "usda": f"""#usda 1.0\n(\n upAxis = "Z"\n metersPerUnit = 1\n)\ndef Mesh "room" {{
            int[] faceVertexCounts = {[4] * 6}
            int[] faceVertexIndices = {[k for f in faces for k in f]}
            point3f[] points = {corners}\n}}\n""",
    }
    (tmp_path / f"room.{kind}").write_text(texts[kind])
    notes = opened(tmp_path / f"room.{kind}")
    if said:
        assert any(said in note for note in notes)
    else:
        assert not any("room" in note for note in notes)


def test_a_tf_of_3ds_max_makes_no_glass_and_that_of_glass_does(tmp_path):
    kinds = {
        "wall": "d 1\nTr 1\nTf 1 1 1\nillum 2",
        "pane": "d 1.0\nTf 1 1 1\nillum 4",
        "veil": "d 0.5\nTf 1 1 1\nillum 2",
    }
    (tmp_path / "max.mtl").write_text(
        "".join(f"newmtl {name}\n{lines}\n\n" for name, lines in kinds.items())
    )
    faces = "".join(f"usemtl {name}\nf 1 2 3\n" for name in kinds)
    (tmp_path / "room.obj").write_text(f"mtllib max.mtl\nv 0 0 0\nv 3 0 0\nv 0 2 3\n{faces}")
    notes = opened(tmp_path / "room.obj")
    glass = {}
    for name in kinds:
        surface = bpy.data.materials[name].node_tree.nodes["Principled BSDF"]
        glass[name] = surface.inputs["Transmission Weight"]
    assert {name: weight.default_value for name, weight in glass.items()} == {
        "wall": 0.0,
        "pane": 1.0,
        "veil": 1.0,
    }
    assert any("opaque materials (wall)" in note for note in notes)


def test_a_gltf_with_an_extension_that_blender_lacks_is_refused_in_one_line(tmp_path, capsys):
    path = tmp_path / "packed.gltf"
    names = ["EXT_that_nobody_has"]
    path.write_text(
        json.dumps(
            {"asset": {"version": "2.0"}, "extensionsUsed": names, "extensionsRequired": names}
        )
    )
    with pytest.raises(InputError, match="EXT_that_nobody_has is not .*; try exporting"):
        opened(path)
    assert capsys.readouterr().out == ""


def test_a_gltf_without_its_textures_is_told_in_one_note(exported, tmp_path, capsys):
    for name in ("room.gltf", "room.bin"):
        shutil.copy(exported["gltf"].parent / name, tmp_path)
    assert any("textures that are missing" in note for note in opened(tmp_path / "room.gltf"))
    assert capsys.readouterr() == ("", "")


def moved(exported, tmp_path, matrix):
    """The OBJ with its vertices and normals taken elsewhere, textures beside it."""
    shutil.copytree(exported["obj"].parent / "tex", tmp_path / "tex", dirs_exist_ok=True)
    shutil.copy(exported["obj"].with_suffix(".mtl"), tmp_path)
    lines = exported["obj"].read_text().splitlines()
    for number, line in enumerate(lines):
        word, *rest = line.split(" ")
        if word in ("v", "vn"):
            to = matrix if word == "v" else matrix / abs(np.linalg.det(matrix)) ** (1 / 3)
            lines[number] = " ".join([word, *(f"{x:.7g}" for x in to @ np.array(rest[:3], float))])
    path = tmp_path / "moved.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


Y_TO_Z = scene_axes.UP["y"]


@pytest.mark.parametrize(
    ("matrix", "reading"),
    [
        (Y_TO_Z, {}),  # z up: guessed from the shape
        (100 * np.eye(3), {}),  # centimetres: guessed from the size
        (1000 * Y_TO_Z, {}),  # millimetres, z up
        (np.diag([-1, 1, 1]), {"mirror": "x"}),
        (np.diag([1, 1, -1]) / 0.0254, {"mirror": "z", "unit_m": 0.0254}),
        (np.linalg.inv(scene_axes.UP["x"]) @ Y_TO_Z, {"up": "x"}),
        (np.linalg.inv(scene_axes.UP["-y"]) @ Y_TO_Z, {"up": "-y"}),
    ],
)
def test_axes_units_and_mirrors_lead_to_the_same_world(exported, points, tmp_path, matrix, reading):
    opened(moved(exported, tmp_path, matrix), **reading)
    assert np.allclose(made.points_of(surfaces.triangles()), points, atol=1e-3)


def test_a_mirrored_file_has_normals_that_point_outwards_again(exported, tmp_path):
    opened(moved(exported, tmp_path, np.diag([-1, 1, 1])), mirror="x")
    crate = next(o for o in bpy.context.scene.objects if o.name.startswith("crate"))
    centre = np.mean([v.co for v in crate.data.vertices], axis=0)
    for face in crate.data.polygons:
        assert np.dot(np.array(face.center) - centre, face.normal) > 0
        for corner in face.loop_indices:
            assert np.dot(crate.data.corner_normals[corner].vector, face.normal) > 0.99


def test_units_of_a_blend_keep_the_picture(tmp_path):
    """A scene drawn in centimetres, light included, sends the same light as the one in metres."""
    made.fresh(bpy)
    made.box(bpy, "box", (0, 0, 0), (100, 100, 250))
    lamp = made.lamp(bpy, "AREA", 100.0, (0, 0, 300))
    lamp.data.size = 50.0
    bpy.context.scene.unit_settings.system = "METRIC"
    bpy.context.scene.unit_settings.scale_length = 0.01
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cm.blend"))
    notes = opened(tmp_path / "cm.blend")
    assert any("centimetres" in note for note in notes)
    assert surfaces.triangles().vertices.max(0) == pytest.approx([1, 1, 2.5])
    lamp = next(o for o in bpy.context.scene.objects if o.type == "LIGHT")
    size = lamp.data.size * lamp.matrix_world.to_scale().x
    assert size == pytest.approx(0.5)
    assert lamp.data.energy / size**2 == pytest.approx(100.0 / 50.0**2)


def test_scripts_of_a_blend_never_run(tmp_path):
    made.fresh(bpy)
    mark = tmp_path / "ran"
    text = bpy.data.texts.new("start.py")
    text.from_string(
        f"import bpy\nopen({str(mark)!r}, 'w').close()\n"
        "bpy.app.handlers.frame_change_post.append(print)"
    )
    text.use_module = True
    box = made.box(bpy, "box", (0, 0, 0), (1, 1, 1))
    driver = box.driver_add("location", 0).driver
    driver.expression = f"len(str(open({str(mark)!r}, 'w')))"
    sky = bpy.context.scene.world = bpy.data.worlds.new("sky")
    sky.driver_add("color", 0).driver.expression = driver.expression
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "script.blend"))
    mark.unlink(missing_ok=True)
    notes = opened(tmp_path / "script.blend")
    bpy.context.scene.frame_set(3)
    surfaces.triangles()
    assert not mark.exists()
    assert not bpy.app.handlers.frame_change_post
    assert "scripts in the file (start.py): not run" in notes
    assert "drivers that need Python (box, sky): not run" in notes


@pytest.mark.parametrize("kind", ["obj", "gltf", "blend"])
def test_textures_from_outside_the_folder_are_refused_unless_allowed(exported, tmp_path, kind):
    inside = tmp_path / "scene"
    inside.mkdir()
    made.picture(bpy, tmp_path / "floor.png")
    if kind == "blend":
        made.fresh(bpy)
        image = bpy.data.images.load(str(tmp_path / "floor.png"))
        made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "m", image=image))
        bpy.ops.wm.save_as_mainfile(filepath=str(inside / "room.blend"))
    else:
        for name in ("room.obj", "room.mtl", "room.gltf", "room.bin"):
            shutil.copy(exported["blend"].with_name(name), inside)
        for name in ("room.mtl", "room.gltf"):
            text = (inside / name).read_text()
            (inside / name).write_text(
                text.replace("tex/floor.png", "../floor.png").replace('"floor.png', '"../floor.png')
            )
    file = inside / f"room.{kind}"
    with pytest.raises(InputError, match="own folder.*floor.png.*textures DIR"):
        opened(file)
    opened(file, textures=str(tmp_path))


def test_a_missing_texture_is_named_and_gives_way_to_the_plain_colour(exported, tmp_path):
    for name in ("room.obj", "room.mtl"):
        shutil.copy(exported["blend"].with_name(name), tmp_path)
    (tmp_path / "tex").mkdir()
    (tmp_path / "tex/floor.png").write_bytes(b"not a picture")
    notes = opened(tmp_path / "room.obj")
    assert any("missing or broken (floor.png)" in note for note in notes)
    assert not any(image.name == "floor.png" for image in bpy.data.images)


def test_the_hash_covers_textures_and_materials(exported, tmp_path):
    shutil.copytree(exported["blend"].parent, tmp_path / "copy")
    hashes = {}
    for kind in ("blend", "obj", "gltf"):
        opened(tmp_path / f"copy/room.{kind}")
        hashes[kind] = scene.scene_sha256(str(tmp_path / f"copy/room.{kind}"))
    for picture in (tmp_path / "copy").rglob("floor.png"):
        made.picture(bpy, picture, value=0.25)
    for kind, before in hashes.items():
        opened(tmp_path / f"copy/room.{kind}")
        assert scene.scene_sha256(str(tmp_path / f"copy/room.{kind}")) != before


def test_broken_numbers_are_left_out_and_told(tmp_path):
    lines = ["v 0 0 0", "v 4 0 0", "v 4 0 4", "v 0 0 4", "v nan 0 0", "v 1 1e30 0", "v 2 2 2"]
    lines += ["f 1 2 3 4", "f 1 2 5", "f 1 2 6", "f 1 1 2", "f 7 7 7"]
    (tmp_path / "broken.obj").write_text("\n".join(lines) + "\n")
    notes = opened(tmp_path / "broken.obj", unit_m=1.0)
    found = surfaces.triangles()
    assert np.isfinite(found.vertices).all()
    assert np.abs(found.vertices).max() <= 4
    assert any("have NaN" in note for note in notes)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.obj", b"", "empty file"),
        ("a.obj", b"# nothing\n", "at least one surface"),
        ("a.gltf", b"{}", "Blender can read"),
        ("a.glb", b"glTF" + bytes(40), "Blender can read"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "no header"),
        ("a.blend", b"BLENDER-v279" + bytes(99), "Blender can read"),
        ("a.fbx", b"Kaydara FBX Binary  \0", "Blender can read"),
        ("a.usdc", b"PXR-USDC" + bytes(80), "scene"),
        ("a.usda", b'#usda 1.0\ndef Mesh "a"\n{\n!\n}\n', r"a.usda:4: .* cannot parse: !"),
        ("a.stl", b"solid", "ending in"),
    ],
)
def test_files_that_are_no_scene_are_refused_in_words(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words):
        opened(tmp_path / name)


def test_vertex_numbers_beyond_the_end_do_not_reach_blenders_ply_reader(exported, tmp_path):
    data = bytearray(exported["ply"].read_bytes())
    data[-2] = 0x7F
    (tmp_path / "wild.ply").write_bytes(data)
    with pytest.raises(InputError, match="vertices 0"):
        opened(tmp_path / "wild.ply")


def test_a_coloured_scan_shows_its_colours(tmp_path):
    rows = ["0 0 0 255 0 0", "1 0 0 255 0 0", "0 1 0 255 0 0"]
    head = "ply\nformat ascii 1.0\nelement vertex 3\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
    text = (
        head
        + "property list uchar int vertex_indices\nend_header\n"
        + "\n".join(rows)
        + "\n3 0 1 2\n"
    )
    (tmp_path / "scan.ply").write_text(text)
    notes = opened(tmp_path / "scan.ply")
    assert any("show the colours of" in note for note in notes)
    assert bpy.context.scene.objects[0].material_slots[0].material is not None


def test_a_file_that_was_saved_in_edit_mode_keeps_its_uv_maps(tmp_path):
    bpy.ops.wm.read_factory_settings()  # with the cube
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "edited.blend"))
    opened(tmp_path / "edited.blend")
    mesh = bpy.data.objects["Cube"].data
    assert len(mesh.uv_layers[0].data) == len(mesh.loops) > 0


def test_a_file_whose_active_scene_is_empty_names_the_others(tmp_path):
    bpy.ops.wm.read_factory_settings()
    bpy.context.window.scene = bpy.data.scenes.new("empty")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    with pytest.raises(InputError, match=r"surface, found none; try .* scene active \(Scene\)"):
        opened(tmp_path / "two.blend")


def test_rough_metal_is_named_where_it_is_seen_at_one_sample():
    made.fresh(bpy)
    looks = {"brushed": (1.0, 0.3), "mirror": (1.0, 0.1), "paint": (0.0, 0.3)}
    for name, (metallic, roughness) in looks.items():
        seen = made.material(bpy, name, Metallic=metallic, Roughness=roughness)
        made.box(bpy, name, (0, 0, 0), (1, 1, 1), seen)
    assert not any("metal" in note for note in preflight.findings(baked=True))
    found = [note for note in preflight.findings(True, noisy=True) if "metal" in note]
    assert [note.partition(":")[0] for note in found] == ["rough metal (brushed)"]


def test_what_the_author_draws_over_the_image_is_named_as_left_out(room):
    opened(room)
    scene = bpy.context.scene
    assert not any("left out" in note for note in preflight.findings(baked=False))
    scene.render.use_freestyle = True
    if hasattr(scene, "compositing_node_group"):
        scene.compositing_node_group = bpy.data.node_groups.new("over", "CompositorNodeTree")
    else:
        scene.use_nodes = True
    assert "Freestyle lines: left out" in "".join(preflight.findings(baked=False))
    compat.compositor(scene).nodes.new("CompositorNodeGlare")
    assert "lines and effects of the compositor: left" in "".join(preflight.findings(baked=False))


def test_settings_of_the_view_layer_that_hide_or_paint_are_named(room):
    opened(room)
    layer = bpy.context.scene.view_layers[0]
    assert not any("view layer" in note for note in preflight.findings(baked=False))
    layer.use_sky = False
    layer.material_override = bpy.data.materials["wall"]
    words = "view layer (material_override, use_sky): not applied"
    assert words in "".join(preflight.findings(baked=False))


def test_what_moves_leads_to_path_tracing_with_a_word(room):
    opened(room)
    job = RenderJob("own", str(room), "kt2")
    assert light_choice.with_possible_light(job) == (job, [])  # the camera moves, nothing else
    crate = bpy.data.objects["crate"]
    for frame, z in ((1, 0.0), (9, 1.0)):
        crate.location.z = z
        crate.keyframe_insert("location", frame=frame)
    changed, words = light_choice.with_possible_light(job)
    assert changed.light == "path"
    assert "move (crate): path traced" in words[0]


def test_smoke_in_a_thing_is_named_as_what_keeps_a_map_from_being_baked(room):
    opened(room)
    tree = bpy.data.objects["crate"].active_material.node_tree
    smoke = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(smoke.outputs[0], tree.nodes["Material Output"].inputs["Volume"])
    here = bpy.context.scene
    smoky = [
        o.name for o in here.objects if o.active_material and o.active_material.node_tree == tree
    ]
    assert "crate" in smoky and light_choice.volume_names(here) == sorted(smoky)
    assert light_choice.reason_against_baking(here).startswith("volumes (")


def test_a_face_with_nothing_behind_it_is_of_a_sheet():
    made.fresh(bpy)
    grey = made.material(bpy, "grey")
    box = made.box(bpy, "box", (0, 0, 0), (1, 1, 1), grey)
    sheet = made.add(bpy, "sheet", [(0, 0, 3), (1, 0, 3), (1, 1, 3.5)], [(0, 1, 2)], grey)
    bpy.context.view_layer.update()
    found = faces.Faces(bpy.context.evaluated_depsgraph_get(), [box, sheet])
    assert [found.is_sheet(row) for row in range(7)] == 6 * [False] + [True]


def test_a_timeline_that_does_not_start_at_0_is_named_where_things_move(room):
    opened(room)
    here = bpy.context.scene
    crate = bpy.data.objects["crate"]
    assert camera.timeline_note(here) is None  # the camera moves, nothing else
    for frame, z in ((1, 0.0), (9, 1.0)):
        crate.location.z = z
        crate.keyframe_insert("location", frame=frame)
    assert "starts at frame 1" in camera.timeline_note(here)
    here.frame_start = 0
    assert camera.timeline_note(here) is None


def test_what_hangs_on_a_moving_thing_moves_and_a_constant_action_does_not(room):
    opened(room)
    crate = bpy.data.objects["crate"]
    chest = bpy.data.objects["chest"]
    crate.keyframe_insert("location", frame=1)
    crate.keyframe_insert("location", frame=9)
    assert motion.moving_names(bpy.context.scene) == []
    chest.parent = crate
    crate.location.x = 3
    crate.keyframe_insert("location", frame=9)
    assert motion.moving_names(bpy.context.scene) == ["chest", "crate"]


def test_a_lamp_or_a_material_that_changes_is_found(room):
    opened(room)
    lamp = bpy.data.objects["lamp"].data
    for frame, energy in ((1, 1.0), (9, 5.0)):
        lamp.energy = energy
        lamp.keyframe_insert("energy", frame=frame)
    assert motion.moving_names(bpy.context.scene) == ["lamp"]


def test_a_scene_without_light_gets_one_and_a_closed_one_gets_lamps_inside(tmp_path):
    made.fresh(bpy)
    made.box(bpy, "crate", (0, 0, 0), (1.2, 1.2, 1.2))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "open.blend"))
    notes = opened(tmp_path / "open.blend")
    assert "inside" not in next(n for n in notes if "uniform white sky was added" in n)
    for inwards in (True, False):
        made.fresh(bpy)
        room = made.box(bpy, "room", (-2, -2, 0), (2, 2, 2.5))
        if inwards:
            room.data.flip_normals()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "closed.blend"))
        assert any("lamps inside" in n for n in opened(tmp_path / "closed.blend"))
        lamps = [o for o in bpy.context.scene.objects if o.type == "LIGHT"]
        assert lamps and all(abs(o.location.x) < 2 and 0 < o.location.z < 2.5 for o in lamps)


def test_displacement_by_a_material_is_in_the_mesh_as_the_formula_has_it(tmp_path):
    """Height 0.2 (1 - 0.5) along z at every vertex of a plane."""
    made.fresh(bpy)
    material = made.material(bpy, "lifted")
    tree = material.node_tree
    lift = tree.nodes.new("ShaderNodeDisplacement")
    lift.inputs["Height"].default_value = 1.0
    lift.inputs["Midlevel"].default_value = 0.5
    lift.inputs["Scale"].default_value = 0.2
    tree.links.new(lift.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    material.displacement_method = "DISPLACEMENT"
    plane = made.add(
        bpy, "plane", [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], [(0, 1, 2, 3)], material
    )
    plane.location = (1, 2, 3)
    plane.rotation_euler = (0, 0, math.radians(30))
    made.lamp(bpy)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lifted.blend"))
    notes = opened(tmp_path / "lifted.blend")
    assert any("displaced surfaces (plane)" in note for note in notes)
    assert surfaces.triangles().vertices[:, 2] == pytest.approx(3.1, abs=1e-5)
    assert displacement.displace_meshes(bpy.context.scene) == []


def test_the_file_stays_as_it_was(room):
    before = room.read_bytes()
    opened(room)
    light_choice.with_possible_light(RenderJob("own", str(room), "kt2"))
    assert room.read_bytes() == before


def test_generated_coordinates_keep_the_box_of_the_mesh_before_its_modifiers():
    made.fresh(bpy)
    crate = made.box(bpy, "crate", (0, 0, 0), (1, 2, 3))
    crate.modifiers.new("round", "SUBSURF").render_levels = 2
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        mesh = surfaces.parts(depsgraph)[0].mesh
    assert len(mesh.polygons) > 90
    assert tuple(mesh.texspace_location) == pytest.approx((0.5, 1, 1.5), abs=1e-3)
    assert tuple(mesh.texspace_size) == pytest.approx((0.5, 1, 1.5), abs=1e-3)
