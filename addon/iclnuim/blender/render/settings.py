"""Render settings: everything that determines a pixel is set here, so that the opened file's own
settings have no effect; but for those of the light of a user's .blend, if it is path traced.
"""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy

from ... import shipped
from ...errors import WorkError
from ...job import RenderJob
from .. import compat
from ..notes import names_of
from ..shader_nodes import add_node, set_constant

#: Inputs of a Principled surface that are 0 without gloss.
_MATT = {"Specular IOR Level", "Metallic", "Coat Weight", "Sheen Weight"}
#: Cycles' first ray, which gives Z, misses the pixel centre by half a step of the filter's table:
#: 8e-5 px with the narrow filter, 5e-4 px and more with a wide one. A BOX filter is one pixel wide,
#: whatever its width setting is.
CENTRE_FILTER_PX = 0.01
WIDE_FILTER_PX = 1.5
#: Cycles' settings of every frame. The bounces are those of path tracing: more change these rooms
#: by less than the noise. With a fixed seed all frames would have the same noise pattern.
#: sample_clamp_indirect limits the light of a path with bounces, to avoid fireflies. In tiles (by
#: default of images over 2048 x 2048 pixels), Cycles has no passes in memory: frames would be
#: black. From 5.2 on tiles cannot be turned off, only be as large as possible.
_CYCLES = {
    "device": "CPU", "shading_system": False, "sample_offset": 0, "use_adaptive_sampling": False,
    "time_limit": 0.0,
    "use_animated_seed": True, "max_bounces": 8, "diffuse_bounces": 4, "glossy_bounces": 4,
    "transmission_bounces": 8,
    "transparent_max_bounces": 16, "caustics_reflective": False, "caustics_refractive": False,
    "sample_clamp_direct": 0.0,
    "direct_light_sampling_type": "MULTIPLE_IMPORTANCE_SAMPLING",
    "sample_clamp_indirect": 10.0, "use_light_tree": True, "use_guiding": False,
    "debug_use_spatial_splits": True,
    "pixel_filter_type": "BLACKMAN_HARRIS", "film_exposure": 1.0, "use_sample_subset": False,
    "use_fast_gi": False, "blur_glossy": 1.0, "light_sampling_threshold": 0.01,
    "texture_limit_render": "OFF",
    "use_auto_tile": False, "tile_size": compat.LARGEST_TILE_PX, "sampling_pattern": "AUTOMATIC",
    "scrambling_distance": 1.0, "auto_scrambling_distance": False,
}  # fmt: skip
#: How far light goes, which a user's .blend decides for its own path tracing.
LIGHT_OF_A_FILE = (
    "max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces",
    "transparent_max_bounces", "sample_clamp_direct", "sample_clamp_indirect", "use_fast_gi",
)  # fmt: skip
#: Settings of the view layer: files hide surfaces or the sky with these, or set another number of
#: samples.
_LAYER = {
    "samples": 0,
    "use_solid": True,
    "use_sky": True,
    "use_strand": True,
    "use_volumes": True,
    "material_override": None,
}
_DENOISER = {
    "denoiser": "OPENIMAGEDENOISE", "denoising_use_gpu": False, "denoising_input_passes":
    "RGB_ALBEDO_NORMAL",
    "denoising_prefilter": "FAST",
}  # fmt: skip
_RENDER = {
    "engine": "CYCLES", "film_transparent": False, "use_motion_blur": False, "use_persistent_data":
    True, "use_simplify": False,
    "use_border": False, "use_crop_to_border": False, "use_multiview": False, "use_compositing":
    False, "use_sequencer": False,
    "use_freestyle": False, "use_file_extension": False, "use_overwrite": True, "use_placeholder":
    False,
}  # fmt: skip


def apply(job: RenderJob, threads: int | None = None) -> None:
    """Set up Cycles on the CPU for `job`, with linear 32-bit multilayer EXR with Z. Raises
    WorkError if a required denoiser is missing.

    Rays go through the pixel centre; with antialias they are spread over neighbouring pixels.
    """
    if job.denoise and not compat.has_denoiser():
        hint = "more {samples} without {denoise}, or the bpy package"
        raise WorkError("this Blender has no OpenImageDenoise", hint=hint)
    scene = bpy.context.scene
    layer = scene.view_layers[0]
    if job.lambertian:
        remove_gloss()
    assign(scene.render, _RENDER)
    kept = LIGHT_OF_A_FILE if _keeps_its_light(job) else ()
    assign(scene.cycles, {name: value for name, value in _CYCLES.items() if name not in kept})
    scene.cycles.samples = job.samples
    scene.cycles.seed = job.seed
    scene.cycles.filter_width = WIDE_FILTER_PX if job.antialias else CENTRE_FILTER_PX
    scene.cycles.use_denoising = job.denoise
    if job.denoise:
        assign(scene.cycles, _DENOISER)
    compat.set_multilayer_exr(scene.render.image_settings)
    # with date and times in the header, files of equal frames would differ
    stamps = [name for name in dir(scene.render) if name.startswith("use_stamp")]
    assign(scene.render, dict.fromkeys(stamps, False))
    passes = [name for name in dir(layer) if name.startswith("use_pass_")]
    assign(layer, {name: name in ("use_pass_combined", "use_pass_z") for name in passes})
    # a pane of glass counts as a surface: Z is that of the first surface a ray hits
    layer.pass_alpha_threshold = 0.0
    assign(layer, _LAYER)
    assign(layer.cycles, {"denoising_store_passes": False, "use_denoising": True})
    if threads:
        scene.render.threads_mode = "FIXED"
        scene.render.threads = threads


def not_in_a_map() -> list[str]:
    """A note on what the open file says of its light and a light map does not follow: what is not
    Blender's default.
    """
    cycles = bpy.context.scene.cycles
    defaults = cycles.bl_rna.properties
    own = [n for n in LIGHT_OF_A_FILE if getattr(cycles, n) != defaults[n].default]
    if not own:
        return []
    return [f"light settings of the file ({names_of(own)}): not applied to baked light"]


def _keeps_its_light(job: RenderJob) -> bool:
    """Whether the scene has settings of its own, and is rendered in a way that can keep them."""
    is_blend = Path(job.scene).suffix.lower() == ".blend"
    return is_blend and not shipped.is_scene(job.scene) and job.light == "path"


def assign(thing: object, values: Mapping[str, object]) -> None:
    """Set properties of a Blender struct."""
    for name, value in values.items():
        setattr(thing, name, value)


@contextmanager
def without_volumes() -> Iterator[None]:
    """Make the volumes of the open scene empty temporarily: a ray that scatters in a volume has no
    Z.
    """
    with ExitStack() as stack:
        for thing in bpy.data.objects:
            if thing.type == "VOLUME":
                stack.enter_context(compat.temporarily(thing, hide_render=True))
        for output in compat.volume_outputs():
            tree = output.id_data
            before = output.inputs["Volume"].links[0].from_socket
            # a volume of density 0: without any volume, its bounds would be a black surface
            empty = tree.nodes.new("ShaderNodeVolumeAbsorption")
            empty.inputs["Density"].default_value = 0.0
            tree.links.new(empty.outputs[0], output.inputs["Volume"])
            stack.callback(tree.nodes.remove, empty)
            stack.callback(tree.links.new, before, output.inputs["Volume"])
        yield


def remove_gloss() -> None:
    """Remove view-dependent reflection from every material of the open scene, to measure the effect
    of reflections on an odometer.

    A mix or sum with a Glossy BSDF is replaced by its other part; a metal becomes a matt surface of
    its colour; specular, metallic, coat and sheen of a Principled surface are set to 0.
    """
    for material in bpy.data.materials:
        if material.use_nodes and material.node_tree:
            _remove_gloss_of(material.node_tree)


def _remove_gloss_of(tree: bpy.types.NodeTree) -> None:
    for node in list(tree.nodes):
        if node.type in ("MIX_SHADER", "ADD_SHADER"):
            shaders = [s for s in node.inputs if s.type == "SHADER" and s.is_linked]
            sources = [shader.links[0].from_socket for shader in shaders]
            others = [s for s in sources if not s.node.type.startswith("BSDF_GLOSSY")]
            if len(shaders) == 2 and len(others) == 1:
                compat.redirect(node.outputs[0], others[0])
    for node in list(tree.nodes):
        if node.type == "BSDF_GLOSSY":
            matt = add_node(tree, "BsdfDiffuse", node.inputs["Color"])
            compat.redirect(node.outputs[0], matt)
            tree.nodes.remove(node)
        elif node.type == "BSDF_PRINCIPLED":
            for name in _MATT & set(node.inputs.keys()):
                set_constant(node.inputs[name], 0.0)
