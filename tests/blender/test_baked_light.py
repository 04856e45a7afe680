"""BakedLight light against formulas and path tracing; the scene it was baked from stays as it was."""

import math

import numpy as np
import pytest
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

SMALL = {"light": "baked", "map_size": 128, "map_samples": 16}
OPTIONS = ("--map-size", "128", "--map-samples", "16")
#: As few samples as a map may have: for tests that do not look at its light.
COARSE = {"light": "baked", "map_size": 32, "map_samples": 2}


def matt_room(path, sun_deg=30.0, strength=2.0, colours=((0.8, 0.3, 0.2), (0.5, 0.5, 0.5))):
    """An open corner of two matt sheets lit by a sun from the right, with a UV map and a modifier
    of its own; saved to `path`.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    quads = {
        "floor": [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)],
        "wall": [(-3, 2, 0), (3, 2, 0), (3, 2, 3), (-3, 2, 3)],
    }
    for (name, corners), colour in zip(quads.items(), colours, strict=True):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        mesh.uv_layers.new(name="own")
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
        out = tree.nodes.new("ShaderNodeOutputMaterial")
        shader.inputs["Color"].default_value = (*colour, 1)
        tree.links.new(shader.outputs[0], out.inputs[0])
        mesh.materials.append(material)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = strength
    sun.data.angle = 0.0
    sun.rotation_euler = (0, math.radians(sun_deg), 0)
    bpy.context.scene.collection.objects.link(sun)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return matt_room(tmp_path_factory.mktemp("matt") / "room.blend")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def picture(render_here, out, room, **light):
    from iclnuim.formats.exr import read_exr

    notes = render_here(out, "0", scene=room, **light)
    channels = read_exr(out / "exr/000000.exr")
    return np.stack([channels[c] for c in "RGB"], -1), notes


@pytest.fixture(scope="module")
def pictures(render_here, room, cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ICLNUIM_CACHE", str(cache))
        baked, said = picture(render_here, folder / "baked", room, **SMALL)
        path, _ = picture(render_here, folder / "path", room, light="path", samples=512)
    return baked, path, said


def test_baked_light_is_what_path_tracing_converges_to(pictures):
    baked, path, _ = pictures
    assert np.median(np.abs(baked - path)) < 0.004
    assert abs(baked.mean() / path.mean() - 1) < 0.02


def test_direct_light_follows_the_formula_where_nothing_else_shines(pictures):
    """The wall faces away from no sun and sees it at 90 degrees: no direct light; the floor gets E
    cos / pi of its colour.
    """
    baked, _, _ = pictures
    floor = baked[-4:, 20:44].reshape(-1, 3).mean(0)
    direct = np.array([0.8, 0.3, 0.2]) * 2.0 * math.cos(math.radians(30)) / math.pi
    assert (floor > 0.99 * direct).all()
    assert (floor < 1.25 * direct).all()  # and some from the wall


def test_the_map_is_baked_once_and_found_again(
    render_here, room, cache, tmp_path, monkeypatch, pictures
):
    monkeypatch.setenv("ICLNUIM_CACHE", str(cache))
    maps = {p: p.stat().st_mtime_ns for p in cache.glob("light/*/light.exr")}
    assert len(maps) == 1
    _, said = picture(render_here, tmp_path / "again", room, **SMALL)
    assert {p: p.stat().st_mtime_ns for p in cache.glob("light/*/light.exr")} == maps
    assert any("light map:" in text for text in pictures[2])
    assert not any("light map:" in text for text in said)


def moved_uv(by):
    for number, loop in enumerate(bpy.data.meshes["floor"].uv_layers["own"].data):
        loop.uv[0] += by * (-1) ** number


EDITS = {
    "a texture coordinate by a texel of a picture 4k wide": lambda: moved_uv(1 / 4096),
    "a vertex by 1 mm": lambda: setattr(bpy.data.meshes["wall"].vertices[0], "co", (-3, 2, 0.001)),
    "a colour": lambda: setattr(
        bpy.data.materials["wall"].node_tree.nodes["Diffuse BSDF"].inputs["Color"],
        "default_value",
        (0.5, 0.5, 0.51, 1),
    ),
    "a lamp": lambda: setattr(bpy.data.lights["sun"], "energy", 2.01),
}


def test_a_map_is_found_again_though_computed_uv_differ_in_the_last_bits_and_not_after_an_edit(
    room, tmp_path, monkeypatch
):
    from iclnuim.blender.render.job_scene import JobScene
    from iclnuim.job import shipped_job

    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path))

    def baked(edit):
        bpy.ops.wm.open_mainfile(filepath=str(room))
        edit()
        file = tmp_path / "edited.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(file))
        job = shipped_job("living_room/kt0").changed(scene=str(file), map_size=32, map_samples=2)
        return JobScene(job, lambda event: None).bake()

    folder, made = baked(lambda: None)
    assert made
    assert baked(lambda: moved_uv(4e-7)) == (folder, False)
    found = {baked(edit) for edit in EDITS.values()}
    assert len(found) == len(EDITS) and all(new and place != folder for place, new in found)
    assert baked(lambda: None) == (folder, False)


def test_another_lamp_is_another_map(render_here, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    monkeypatch.setenv("ICLNUIM_CACHE", str(cache))
    picture(render_here, tmp_path / "first", matt_room(tmp_path / "room.blend"), **COARSE)
    before = set(cache.glob("light/*"))
    brighter = matt_room(tmp_path / "brighter.blend", strength=4.0)
    picture(render_here, tmp_path / "out", brighter, **COARSE)
    assert len(set(cache.glob("light/*")) - before) == 1


def test_showing_a_map_and_taking_it_back_leaves_the_scene_as_it_was(room, cache, pictures):
    from iclnuim.blender.light import light_map
    from iclnuim.blender.open import scene

    scene.open_empty()
    bpy.ops.wm.open_mainfile(filepath=str(room))

    def state():
        objects = sorted((o.name, o.hide_render, o.data.name) for o in bpy.context.scene.objects)
        meshes = [(m.name, len(m.loops), m.uv_layers.keys()) for m in bpy.data.meshes]
        nodes = []
        for material in bpy.data.materials:
            nodes.append((material.name, [n.bl_idname for n in material.node_tree.nodes]))
        return objects, sorted(meshes), sorted(nodes)

    before = state()
    folder = next(iter(cache.glob("light/*/light.exr"))).parent
    lit = light_map.apply(folder)
    assert state() != before
    lit.revert()
    assert state() == before


def test_a_damaged_map_is_named_in_words(render, room, tmp_path, monkeypatch, cache, pictures):
    import shutil

    shutil.copytree(cache, tmp_path / "cache")
    for layout in (tmp_path / "cache").glob("light/*/layout.npz"):
        layout.write_bytes(layout.read_bytes()[:100])
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    done = render(
        tmp_path / "out", "--frames", "0", "--light", "baked", *OPTIONS, scene=room, base=()
    )
    assert done.returncode == 3
    assert "delete this folder and bake again" in done.stderr
    assert "Traceback" not in done.stderr


def test_lambertian_frames_have_no_reflections(render, tmp_path, monkeypatch):
    """A mirror becomes dull: what it shows no longer depends on where the camera stands."""
    from iclnuim.blender.render import settings

    bpy.ops.wm.read_factory_settings(use_empty=True)
    material = bpy.data.materials.new("polished")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    glossy = tree.nodes.new("ShaderNodeBsdfGlossy")
    mix = tree.nodes.new("ShaderNodeMixShader")
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], mix.inputs[1])
    tree.links.new(glossy.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], out.inputs["Surface"])
    settings.remove_gloss()
    assert out.inputs["Surface"].links[0].from_node == diffuse


def test_reflections_of_a_bright_spot_are_clamped_as_path_tracing_clamps_them(tmp_path):
    """A sheet of light 50, seen in a mirror and itself: gloss beside a bare lamp shows specks."""
    from iclnuim.blender import compat
    from iclnuim.blender.light import baked_material
    from iclnuim.blender.render import frames, settings

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    light = bpy.data.images.new("light", 4, 4, float_buffer=True, is_data=True)
    light.pixels.foreach_set(np.full(4 * 4 * 4, 100.0, np.float32))
    plaster, _ = compat.matt_material("wall", (0.5, 0.5, 0.5, 1.0))
    wall = baked_material.baked_copy(plaster, baked_material.BakedLight(light, False, limit=10.0))
    mirror = bpy.data.materials.new("mirror")
    mirror.use_nodes = True
    node = mirror.node_tree.nodes["Principled BSDF"]
    node.inputs["Metallic"].default_value = 1.0
    node.inputs["Roughness"].default_value = 0.0
    node.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    for y, material in ((-1.0, wall), (2.0, mirror)):
        sheet = bpy.data.meshes.new(material.name)
        sheet.from_pydata([(-9, y, -9), (9, y, -9), (9, y, 9), (-9, y, 9)], [], [(0, 1, 2, 3)])
        sheet.uv_layers.new(name=baked_material.FRONT_UV)
        sheet.materials.append(material)
        scene.collection.objects.link(bpy.data.objects.new(material.name, sheet))
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    compat.set_multilayer_exr(scene.render.image_settings)
    settings.assign(scene.view_layers[0], {"use_pass_z": True})
    for towards, seen in ((0.0, 10.0), (math.pi, 50.0)):  # the mirror, the wall itself
        scene.camera.rotation_euler = (math.pi / 2, 0.0, towards)
        frames.render(1, tmp_path / "a.exr")
        assert frames.read(tmp_path / "a.exr", tmp_path / "a.exr")[0] == pytest.approx(
            seen, rel=1e-3
        )


def test_a_bake_says_beforehand_how_long_it_takes_and_one_without_reflections_why(
    room, tmp_path, monkeypatch
):
    """The time is that of the cached map with reflections; without one it is estimated from the
    texels.
    """
    from iclnuim.blender.light import light_files, light_map, scene_key
    from iclnuim.blender.open import scene
    from iclnuim.blender.render import settings
    from iclnuim.formats.files import write_json
    from iclnuim.job import RenderJob

    def made(folder, found, *rest):
        folder.mkdir(parents=True)
        for name in (light_files.MAP, light_files.LAYOUT):
            (folder / name).touch()
        np.savez(folder / light_files.UV, uv=scene_key.uv_of(found))
        write_json(folder / light_files.RECIPE, {"seconds": 386.0})

    scene.open_scene(str(room))
    tree = bpy.data.materials["wall"].node_tree
    gloss = tree.nodes.new("ShaderNodeBsdfPrincipled")
    output = tree.nodes["Material Output"]
    tree.links.new(gloss.outputs[0], output.inputs["Surface"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path))
    monkeypatch.setattr(light_map, "_make", made)
    job = RenderJob("a", str(tmp_path / "room.blend"), "kt0", map_size=32, map_samples=2)
    notes = []
    for lambertian in (False, False, True):
        scene.open_scene(job.scene)
        settings.apply(job.changed(lambertian=lambertian))
        light_map.prepare(job.changed(lambertian=lambertian), notes.append)
    assert notes == [
        "light map: the bake takes about 1 s",
        "light map: without reflections the light differs, so a separate map is baked, "
        "in about 386 s",
    ]


def test_bake_prints_its_figures_and_nothing_else(room, tmp_path, command_here):
    import json
    import os
    import subprocess
    import sys

    command = [
        sys.executable,
        "-m",
        "iclnuim",
        "bake",
        str(room),
        "--map-size",
        "64",
        "--map-samples",
        "2",
        "--json",
    ]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env={**os.environ, "ICLNUIM_CACHE": str(tmp_path)},
        timeout=patience(300),
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["texels"] > 1000
    assert figures["folder"].startswith(str(tmp_path))
    code, _, said = command_here("bake", "no such file.blend")
    assert code == 2 and "no such file" in said


def test_a_point_seen_from_one_place_of_64_is_found(tmp_path):
    """63 places are below a floor, one is above it.

    Points that were called hidden get a quarter of the samples, or no texels.
    """
    from iclnuim.blender.light import light_sampling

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    rng = np.random.default_rng(1)
    places_m = rng.uniform([-2, -2, -2], [2, 1, -1], (64, 3))
    places_m[17] = (0.5, 0.0, 1.5)
    points_m = rng.uniform([-2.5, -2.5, 0], [2.5, 1.5, 0], (2000, 3))
    above, below = (np.tile([0.0, 0.0, z], (2000, 1)) for z in (1, -1))
    assert (light_sampling.seen(points_m, above, places_m, 3) > 0).mean() > 0.995
    assert not light_sampling.seen(points_m, above, np.delete(places_m, 17, 0), 3).any()
    assert light_sampling.seen(points_m, below, places_m, 3).all()
    left = points_m[:, 0] < 0  # called hidden after the first samples, which find about 4 of 64
    some = light_sampling.seen(points_m, above, places_m, 3, hidden=lambda found: left) > 0
    assert some[~left].mean() > 0.995
    assert 0.01 < some[left].mean() < 0.2


def test_the_sky_is_the_same_with_the_lamps_and_with_the_surfaces(tmp_path):
    """The last gathering samples the sky with its own rays.

    A grey sky over an open corner, seen past an emitting wall.
    """
    from iclnuim.blender.light import light_sampling

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    bpy.context.scene.world = sky = bpy.data.worlds.new("sky")
    sky.use_nodes = True
    sky.node_tree.nodes["Background"].inputs["Color"].default_value = (0.4, 0.5, 0.6, 1.0)
    tree = bpy.data.materials["wall"].node_tree
    tree.nodes.clear()
    shine = tree.nodes.new("ShaderNodeEmission")
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    shine.inputs["Strength"].default_value = 0.3
    tree.links.new(shine.outputs[0], out.inputs[0])
    points_m = np.random.default_rng(2).uniform([-2, -2, 0], [2, 1.9, 0], (3000, 3))
    up = np.tile([0.0, 0.0, 1.0], (3000, 1))
    materials = list(bpy.data.materials)

    def light(with_lamps, with_surfaces):
        lamps = light_sampling.direct(points_m, up, 64, 1, materials, sky=with_lamps)
        return lamps, light_sampling.gathered(points_m, up, 64, 1, sky=with_surfaces)

    (lamps, surfaces) = light(True, False)
    (lamps_alone, together) = light(False, True)
    assert lamps_alone.mean() < 0.9 * lamps.mean() and together.mean() > 1.5 * surfaces.mean()
    assert (lamps_alone + together).mean((0, 1)) == pytest.approx(
        (lamps + surfaces).mean((0, 1)), rel=0.003
    )


def test_hidden_texels_get_fewer_samples_and_the_same_light(tmp_path, monkeypatch):
    """The back of the wall is seen by no place in front of it; the sun that lights it is low behind
    it.
    """
    from iclnuim.blender import surfaces
    from iclnuim.blender.light import light_sampling, map_points
    from iclnuim.blender.render import settings
    from iclnuim.job import RenderJob
    from iclnuim.lightmap.layout import lay_out

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    bpy.data.objects["sun"].rotation_euler = (math.radians(-60), 0, 0)
    settings.apply(RenderJob("a", str(tmp_path / "room.blend"), "kt0", light="baked"), 1)
    with surfaces.rendered_parts() as (found, _):
        whole = surfaces.joined(found)
        layout = lay_out(whole, np.ones((whole.faces, 2), bool), 64)
        points_m, normals = layout.points()
        seen = normals[:, 2] + (normals[:, 1] < -0.5) > 0.5  # the floor's top and the wall's front
        texels = map_points.MapPoints(
            layout, seen, np.array([[0.0, 0.0, 1.5]]), 32, 1, np.zeros(whole.faces, bool)
        )
        asked = []
        irradiance = light_sampling.direct
        monkeypatch.setattr(
            light_sampling,
            "direct",
            lambda p, n, samples, *a, **k: (
                asked.append((samples, len(p))) or irradiance(p, n, samples, *a, **k)
            ),
        )
        light = texels.direct()
    shares = dict(asked)
    assert (
        set(shares) == {32, 8}
        and sum(shares.values()) == len(points_m)
        and shares[8] > 0.2 * len(points_m)
    )
    back = (normals[:, 1] > 0.5) & (points_m[:, 2] > 0.1)
    lit = (points_m[:, 2] > 0.1) & (normals[:, 1] < -0.5)
    assert light[:, lit].max() == 0
    # irradiance 2 at 60 degrees from the zenith on an upright wall: 2 sin 60, as the radiance of a
    # white surface / pi
    assert light[:, back] == pytest.approx(2 * math.sin(math.radians(60)) / math.pi, rel=0.01)


def _point_lamps(count):
    """Point lamps without size at different places above the corner, with different powers; their
    names and powers in W.
    """
    for lamp in [o for o in bpy.data.objects if o.type == "LIGHT"]:
        bpy.data.objects.remove(lamp)
    lamps = []
    for k in range(count):
        data = bpy.data.lights.new(f"lamp {k}", "POINT")
        data.energy = 10.0 * (1 + k)
        data.shadow_soft_size = 0.0
        thing = bpy.data.objects.new(f"lamp {k}", data)
        thing.location = (-2 + 0.5 * k, -1 - 0.1 * k, 1.5 + 0.2 * k)
        bpy.context.scene.collection.objects.link(thing)
        lamps.append(thing)
    return lamps


def test_small_lamps_share_passes_and_each_gets_the_same_number_of_samples(tmp_path):
    """Seven lamps take passes of four, two and one.

    The light of a point lamp on a visible point is the same for every sample, so it has no noise.
    """
    from iclnuim.blender.light import light_sampling

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    lamps = _point_lamps(8)
    lamps[2].data.energy = 0.0  # gets no samples, and does not count
    bpy.context.view_layer.update()
    passes = light_sampling._lamp_passes(light_sampling._sources()[0], 16)
    assert [(len(one.lamps), one.samples) for one in passes] == [(4, 8), (2, 4), (1, 2)]
    points_m = np.random.default_rng(4).uniform([-2, -2, 0], [2, 1.9, 0], (2000, 3))
    light = light_sampling.direct(
        points_m, np.tile([0.0, 0.0, 1.0], (2000, 1)), 32, 1, list(bpy.data.materials)
    )
    ways = np.array([lamp.location for lamp in lamps])[:, None] - points_m
    # radiant intensity of a point lamp is power / (4 pi), radiance of a white surface is irradiance
    # / pi
    squared = (ways**2).sum(-1)
    power = np.array([lamp.data.energy for lamp in lamps])[:, None]
    expected = (power * ways[..., 2] / squared**1.5).sum(0) / (4 * np.pi) / np.pi
    assert light[0, :, 0] == pytest.approx(expected, rel=2e-3)
    assert light[1, :, 0] == pytest.approx(expected, rel=2e-3)


def test_large_lamps_share_passes_only_with_one_sample_each(tmp_path):
    from iclnuim.blender.light import light_sampling

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    lamps = _point_lamps(10)
    for lamp in lamps[2:]:
        lamp.data.shadow_soft_size = 0.5

    def passes(samples):
        found = light_sampling._lamp_passes(lamps, samples)
        return [(len(one.lamps), one.samples) for one in found]

    assert passes(12) == [(2, 2), *[(1, 4)] * 8]
    assert passes(24) == [(2, 6), *[(1, 8)] * 8]
    assert passes(4) == [(8, 8), (2, 2)]


def test_the_halves_of_the_samples_have_independent_noise(tmp_path):
    """They are baked at once.

    In the penumbra of a large lamp behind a wall, the product of both halves' errors is zero in the
    mean.
    """
    from iclnuim.blender.light import light_sampling

    bpy.ops.wm.open_mainfile(filepath=str(matt_room(tmp_path / "room.blend")))
    (lamp,) = _point_lamps(1)
    lamp.data.shadow_soft_size = 2.0
    lamp.location = (0, 4, 8)
    bpy.context.view_layer.update()
    points_m = np.random.default_rng(5).uniform([-2, -2, 0], [2, 1.9, 0], (4000, 3))
    up = np.tile([0.0, 0.0, 1.0], (4000, 1))
    materials = list(bpy.data.materials)
    a, b = light_sampling.direct(points_m, up, 8, 1, materials)[..., 0]
    errors = np.stack([a, b]) - light_sampling.direct(points_m, up, 512, 2, materials).mean(0)[:, 0]
    noisy = np.abs(errors).max(0) > 0
    assert noisy.mean() > 0.1
    assert abs(np.corrcoef(errors[:, noisy])[0, 1]) < 0.08


def _sky_of(*nodes):
    """A world whose Background has the colour of the last node; each node gets its vector from the
    one before.
    """
    bpy.context.scene.world = sky = bpy.data.worlds.new("sky")
    sky.use_nodes = True
    tree = sky.node_tree
    made = [tree.nodes.new(name) for name in nodes]
    for before, node in zip(made, made[1:], strict=False):
        tree.links.new(before.outputs[0], node.inputs["Vector"])
    if made:
        tree.links.new(made[-1].outputs["Color"], tree.nodes["Background"].inputs["Color"])
    return sky, made


def test_a_black_sky_is_not_sampled():
    from iclnuim.blender.sky import gives_light

    bpy.ops.wm.read_factory_settings(use_empty=True)
    sky, _ = _sky_of()
    background = sky.node_tree.nodes["Background"]
    assert gives_light(sky) and not gives_light(None)
    background.inputs["Strength"].default_value = 0.0
    assert not gives_light(sky)
    background.inputs["Strength"].default_value = 1.0
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    assert not gives_light(sky)
    assert gives_light(_sky_of("ShaderNodeTexEnvironment")[0])  # its colour is linked


def test_a_sky_that_is_an_image_is_sampled_at_the_images_size():
    from iclnuim.blender.sky import sampled_at_image_size

    bpy.ops.wm.read_factory_settings(use_empty=True)

    def width(sky):
        with sampled_at_image_size(sky):
            return (
                sky.cycles.sample_map_resolution if sky.cycles.sampling_method == "MANUAL" else None
            )

    sky, (image,) = _sky_of("ShaderNodeTexEnvironment")
    assert width(sky) is None  # without an image
    image.image = bpy.data.images.new("sky", 640, 320)
    assert width(sky) == 640 and sky.cycles.sampling_method == "AUTOMATIC"
    image.projection = "MIRROR_BALL"
    assert width(sky) is None
    sky, (*_, image) = _sky_of("ShaderNodeTexCoord", "ShaderNodeTexEnvironment")  # may be scaled
    image.image = bpy.data.images["sky"]
    assert width(sky) is None
    assert width(_sky_of("ShaderNodeTexSky")[0]) is None and width(_sky_of()[0]) is None


@pytest.mark.parametrize(("size_m", "seen"), [(4.0, True), (1.2, False)])
def test_a_room_whose_walls_show_their_backs_is_seen_from_inside_and_a_solid_is_not(size_m, seen):
    """A box with its faces outward and a ball beside it, so that there are places outside too."""
    from iclnuim.blender import surfaces
    from iclnuim.blender.light.viewpoints import viewpoints

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=size_m)
    bpy.ops.mesh.primitive_uv_sphere_add(location=(size_m, 0, 0), radius=0.3)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    places = viewpoints(depsgraph, surfaces.joined(surfaces.parts(depsgraph)), 16, 0)
    assert (np.abs(places) < size_m / 2).all(1).any() == seen
