"""Show arrays as images in the image editor, among them the last frame of a running render."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.types import Area, Context

from ..errors import IclnuimError
from ..geometry.camera import PinholeCamera
from ..sequences.frame_images import noisy_images
from ..sequences.frame_source import read_frame
from ..sequences.sequence_options import SequenceSettings
from . import state
from .pictures import colour_and_depth
from .work import Work

LAST_FRAME = "ICL-NUIM last frame"
#: Minimum time between two reads of the last frame, in seconds.
PAUSE_S = 1.0


class LastFrame:
    """Shows the last frame of a render. Call `look(work)` at each tick."""

    def __init__(self, frames: Path, camera: PinholeCamera) -> None:
        """`frames`: the folder that contains 000000.exr and the following frames."""
        self._frames = frames
        self._camera = camera
        self._at_s = 0.0

    def look(self, work: Work) -> None:
        """Show the last frame, if the pause or the work is over and an image editor is open."""
        number = work.last_frame
        too_soon = work.busy and time.monotonic() - self._at_s < PAUSE_S
        if number is None or too_soon or not state.areas("IMAGE_EDITOR"):
            return
        self._at_s = time.monotonic()
        with suppress(IclnuimError):  # the render reports a frame that cannot be read
            light, depth_z_m = read_frame(self._frames / f"{number:06}.exr", self._camera)
            rgb = noisy_images(light, depth_z_m, self._camera, number, SequenceSettings())[0]
            show(bpy.context, LAST_FRAME, colour_and_depth(rgb, depth_z_m))


def show(context: Context, name: str, picture: np.ndarray) -> None:
    """Show an (h, w, 3) uint8 array as the image `name` in an image editor.

    If none is open, one is opened next to the 3D view.
    """
    height, width = picture.shape[:2]
    image = bpy.data.images.get(name)
    if image is not None and image.size[:] != (width, height):
        bpy.data.images.remove(image)
        image = None
    image = image or bpy.data.images.new(name, width, height)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = picture[::-1].astype(np.float32) / 255
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    if bpy.app.background:
        return
    area = next(iter(state.areas("IMAGE_EDITOR")), None) or _split(context)
    if area is None:
        return
    area.tag_redraw()
    if area.spaces.active.image != image:
        area.spaces.active.image = image
        _fit(context, area)


def _fit(context: Context, area: Area) -> None:
    """Fit the whole image into the editor, after a short delay: a new area has no size before it is
    drawn for the first time.
    """

    def fit() -> None:
        window = context.window_manager.windows[0]
        region = next((r for r in area.regions if r.type == "WINDOW"), None)
        if area.type == "IMAGE_EDITOR" and region is not None:
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.image.view_all(fit_view=True)
            area.tag_redraw()

    state.later(fit)


def _split(context: Context) -> Area | None:
    """Open a new image editor next to the 3D view; None if there is no 3D view."""
    window = context.window or context.window_manager.windows[0]
    areas = window.screen.areas
    views = [area for area in areas if area.type == "VIEW_3D"]
    if not views:
        return None
    view = max(views, key=lambda a: a.width * a.height)
    before = set(areas)
    with context.temp_override(window=window, area=view, region=view.regions[-1]):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    # the new area is the left one: the sidebar with the panel stays where it is
    new = next(area for area in areas if area not in before)
    new = min((new, view), key=lambda a: a.x)
    new.type = "IMAGE_EDITOR"
    return new


@persistent
def _pack(*_: Any) -> None:
    """The file is saved: it would contain the images as black ones."""
    for image in bpy.data.images:
        if image.name.startswith("ICL-NUIM ") and image.is_dirty:
            image.pack()


def register() -> None:
    bpy.app.handlers.save_pre.append(_pack)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_pack)
