"""Render settings: everything that decides a pixel is set here, so that nothing of the opened file's own settings leaks in."""

from contextlib import AbstractContextManager

import bpy

from ..errors import WorkError
from ..job import RenderJob
from . import compat

#: Of a Principled surface without gloss.
_MATT = {"Specular IOR Level": 0.0, "Metallic": 0.0, "Coat Weight": 0.0, "Sheen Weight": 0.0}
#: Bounces of a path-traced frame; more change these rooms by less than the noise.
PATH_BOUNCES = {
    "max_bounces": 8, "diffuse_bounces": 4, "glossy_bounces": 4, "transmission_bounces": 8, "transparent_max_bounces": 16,
}  # fmt: skip
#: No path that bounced brings more light than this to a sample: rare bright ones would be specks.
CLAMP = 10.0

#: Cycles' first ray, from which Z comes, misses the pixel centre by half a step of the filter's table: 8e-5 px with the narrow
#: filter, 5e-4 px and more with a wide one. A BOX filter is one pixel wide whatever its width says.
CENTRE_FILTER_PX, WIDE_FILTER_PX = 0.01, 1.5


def apply(job: RenderJob) -> None:
    """Cycles on the CPU for `job`, linear 32-bit multilayer EXR with Z. Raises WorkError for a denoiser that is not there."""
    if job.denoise and not compat.has_denoiser():
        hint = "more {samples} without {denoise}, or the bpy package"
        raise WorkError("this Blender has no OpenImageDenoise", hint=hint)
    scene = bpy.context.scene
    if job.lambertian:
        remove_gloss()
    _sampling(scene, job)
    _film(scene, job)
    _output(scene.render)
    _passes(scene)


def _sampling(scene: bpy.types.Scene, job: RenderJob) -> None:
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.shading_system = "CPU", False
    cycles.samples, cycles.sample_offset = job.samples, 0
    cycles.use_adaptive_sampling, cycles.time_limit = False, 0.0
    cycles.seed, cycles.use_animated_seed = job.seed, True  # a fixed seed would hang one noise pattern over all frames
    cycles.use_denoising = job.denoise
    if job.denoise:
        cycles.denoiser, cycles.denoising_use_gpu = "OPENIMAGEDENOISE", False
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    for name, value in PATH_BOUNCES.items():
        setattr(cycles, name, value)
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0.0, CLAMP
    cycles.use_light_tree, cycles.use_guiding = True, False
    cycles.debug_use_spatial_splits = True


def _film(scene: bpy.types.Scene, job: RenderJob) -> None:
    """Rays through the pixel centre, or spread over neighbouring pixels with antialias."""
    scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    scene.cycles.filter_width = WIDE_FILTER_PX if job.antialias else CENTRE_FILTER_PX
    scene.cycles.film_exposure = 1.0
    scene.render.film_transparent = False
    scene.render.use_motion_blur = False
    scene.render.use_persistent_data = True
    scene.render.use_simplify = False


def _output(render: bpy.types.RenderSettings) -> None:
    compat.set_multilayer_exr(render.image_settings)
    render.use_border = render.use_crop_to_border = render.use_multiview = False
    render.use_compositing = render.use_sequencer = render.use_freestyle = False
    render.use_file_extension, render.use_overwrite, render.use_placeholder = False, True, False
    for name in dir(render):
        if name.startswith("use_stamp"):  # date and times in the header would make equal frames differ
            setattr(render, name, False)


def _passes(scene: bpy.types.Scene) -> None:
    layer = scene.view_layers[0]
    for other in scene.view_layers:
        other.use = other == layer
    for name in dir(layer):
        if name.startswith("use_pass_"):
            setattr(layer, name, name in ("use_pass_combined", "use_pass_z"))
    layer.pass_alpha_threshold = 0.0  # the pane counts as a surface: Z is that of the first one a ray meets
    layer.material_override = None
    layer.cycles.denoising_store_passes = False


def depth_only() -> AbstractContextManager[None]:
    """One narrow ray a pixel: beside an antialiased picture Z is rendered on its own, so that it is the same bits as without."""
    return compat.temporarily(bpy.context.scene.cycles, filter_width=CENTRE_FILTER_PX, samples=1, use_denoising=False)


def remove_gloss() -> None:
    """Take view-dependent light out of every material of the open scene: what an odometer gains then is what reflections cost it.

    A mix or sum with a Glossy BSDF becomes its other part; a metal becomes a matt surface of its colour; a Principled surface loses
    specular, metallic, coat and sheen.
    """
    for material in bpy.data.materials:
        if material.use_nodes and material.node_tree:
            _without_gloss(material.node_tree)


def _without_gloss(tree: bpy.types.NodeTree) -> None:
    for node in [n for n in tree.nodes if n.type in ("MIX_SHADER", "ADD_SHADER")]:
        shaders = [s for s in node.inputs if s.type == "SHADER" and s.is_linked]
        others = [s.links[0].from_socket for s in shaders if not s.links[0].from_node.type.startswith("BSDF_GLOSSY")]
        if len(shaders) == 2 and len(others) == 1:
            for link in list(node.outputs[0].links):
                tree.links.new(others[0], link.to_socket)
    for node in [n for n in tree.nodes if n.type == "BSDF_GLOSSY"]:
        _as_diffuse(tree, node)
    for node in [n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"]:
        for name, value in _MATT.items():
            if name in node.inputs:
                for link in list(node.inputs[name].links):
                    tree.links.remove(link)
                node.inputs[name].default_value = value


def _as_diffuse(tree: bpy.types.NodeTree, glossy: bpy.types.Node) -> None:
    matt = tree.nodes.new("ShaderNodeBsdfDiffuse")
    matt.inputs["Color"].default_value = glossy.inputs["Color"].default_value
    if glossy.inputs["Color"].is_linked:
        tree.links.new(glossy.inputs["Color"].links[0].from_socket, matt.inputs["Color"])
    for link in list(glossy.outputs[0].links):
        tree.links.new(matt.outputs[0], link.to_socket)
    tree.nodes.remove(glossy)
