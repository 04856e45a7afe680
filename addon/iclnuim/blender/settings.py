"""Render settings: everything that decides a pixel is set here, so that nothing of the opened file's own settings leaks in."""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..errors import WorkError
from ..job import RenderJob
from . import compat

#: Bounces of a path-traced frame; more change these rooms by less than the noise.
PATH_BOUNCES = {
    "max_bounces": 8,
    "diffuse_bounces": 4,
    "glossy_bounces": 4,
    "transmission_bounces": 8,
    "transparent_max_bounces": 16,
}

#: No path that bounced brings more light than this to a sample: rare bright ones would be specks.
CLAMP = 10.0

#: Cycles' first ray, from which Z comes, misses the pixel centre by half a step of the filter's table: 8e-5 px with the narrow
#: filter, 5e-4 px and more with a wide one. A BOX filter is one pixel wide whatever its width says.
CENTRE_FILTER_PX, WIDE_FILTER_PX = 0.01, 1.5


def apply(job: RenderJob) -> None:
    """Cycles on the CPU for `job`, linear 32-bit multilayer EXR with Z. Raises WorkError for a denoiser that is not there."""
    if job.denoise and not compat.has_denoiser():
        raise WorkError(
            "this Blender has no OpenImageDenoise", hint="more {samples} without {denoise}, or the bpy package"
        )
    scene = bpy.context.scene
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


@contextmanager
def depth_only() -> Iterator[None]:
    """One narrow ray a pixel: beside an antialiased picture Z is rendered on its own, so that it is the same bits as without."""
    cycles = bpy.context.scene.cycles
    before = cycles.filter_width, cycles.samples, cycles.use_denoising
    cycles.filter_width, cycles.samples, cycles.use_denoising = CENTRE_FILTER_PX, 1, False
    try:
        yield
    finally:
        cycles.filter_width, cycles.samples, cycles.use_denoising = before
