"""The settings of the light of a user's .blend are kept with path tracing, or named."""

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender.open import preflight  # noqa: E402
from iclnuim.blender.render import settings  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402

#: Other values than Blender's defaults and ours.
OWN = {
    "max_bounces": 3, "diffuse_bounces": 1, "glossy_bounces": 2, "transmission_bounces": 5,
    "transparent_max_bounces": 7, "sample_clamp_direct": 4.0, "sample_clamp_indirect": 5.0,
    "use_fast_gi": True,
}  # fmt: skip


def file_with(values):
    bpy.ops.wm.read_factory_settings(use_empty=False)
    settings.assign(bpy.context.scene.cycles, values)


def applied(scene, **light):
    file_with(OWN)
    settings.apply(RenderJob("a", scene, "kt0", **light))
    return {name: getattr(bpy.context.scene.cycles, name) for name in OWN}


def test_what_a_file_says_of_its_light_is_kept_with_path_tracing_and_nowhere_else():
    assert OWN.keys() == set(settings.LIGHT_OF_A_FILE)
    assert applied("/tmp/room.blend", light="path") == OWN
    others = [applied("/tmp/room.blend", light="baked"), applied("/tmp/room.obj", light="path")]
    others.append(applied("living_room", light="path"))
    assert all(found == others[0] for found in others)
    assert not any(others[0][name] == OWN[name] for name in OWN)


@pytest.mark.parametrize("name", OWN)
def test_a_setting_that_a_light_map_does_not_follow_is_named(name):
    file_with({})
    assert settings.not_in_a_map() == []
    file_with({name: OWN[name]})
    (note,) = settings.not_in_a_map()
    assert name in note and "not applied" in note


@pytest.mark.skipif(not hasattr(bpy.types, "ShaderNodeBsdfRayPortal"), reason="Blender 4.2 has it")
def test_ray_portals_are_named():
    file_with({})
    tree = bpy.data.objects["Cube"].active_material.node_tree
    assert not any("ray portals" in note for note in preflight.findings(False))
    tree.nodes.new("ShaderNodeBsdfRayPortal")
    assert any("ray portals" in note for note in preflight.findings(False))


def test_mirrors_whose_caustics_the_file_asks_for_are_named():
    def mirrors():
        return [note for note in preflight.findings(False) if note.startswith("mirrors (Material)")]

    file_with({"caustics_reflective": True})
    inputs = bpy.data.objects["Cube"].active_material.node_tree.nodes["Principled BSDF"].inputs
    assert not mirrors()
    inputs["Metallic"].default_value, inputs["Roughness"].default_value = 1.0, 0.02
    assert mirrors()
    bpy.context.scene.cycles.caustics_reflective = False
    assert not mirrors()


def view_notes(**view):
    file_with({})
    settings.assign(bpy.context.scene.view_settings, view)
    return [note for note in preflight.findings(False) if "scene-linear RGB" in note]


def test_a_view_that_the_user_chose_is_named_and_blenders_default_is_not():
    assert view_notes() == []
    assert view_notes(exposure=1.0) and view_notes(gamma=1.2)
    assert view_notes(look="AgX - Punchy") and view_notes(view_transform="False Color")


def test_frames_are_denoised_on_the_processor_whatever_a_file_says():
    """The images of two machines are the same."""
    file_with({"denoising_use_gpu": True})
    settings.apply(RenderJob("a", "/tmp/room.blend", "kt0", light="path", denoise=True))
    assert not bpy.context.scene.cycles.denoising_use_gpu
