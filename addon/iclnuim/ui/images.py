"""Pictures put before the user: an array becomes an image of the .blend's session, and an image editor shows it."""

from __future__ import annotations

import bpy
import numpy as np

from . import session


def show(context: bpy.types.Context, name: str, picture: np.ndarray, open_editor: bool = True) -> bpy.types.Image:
    """(h, w, 3) uint8 as the image `name`, in an image editor; one is opened beside the 3D view where there is none."""
    image = _image(name, picture)
    if not bpy.app.background:
        area = _open_editor(context) or (_split(context) if open_editor else None)
        if area is not None and area.spaces.active.image != image:
            area.spaces.active.image = image
            _fit(context, area)
    return image


def editor_is_open(context: bpy.types.Context) -> bool:
    """Whether there is an image editor to show a picture in without changing the window."""
    return not bpy.app.background and _open_editor(context) is not None


def _fit(context: bpy.types.Context, area: bpy.types.Area) -> None:
    """The whole picture in the editor. A new area has no size before its first drawing: then a moment later."""

    def fit() -> None:
        window = context.window_manager.windows[0]
        region = next((r for r in area.regions if r.type == "WINDOW"), None)
        if area.type == "IMAGE_EDITOR" and region is not None:
            with bpy.context.temp_override(window=window, area=area, region=region):
                bpy.ops.image.view_all(fit_view=True)
            area.tag_redraw()

    area.tag_redraw()
    session.later(fit)


def _image(name: str, picture: np.ndarray) -> bpy.types.Image:
    height, width = picture.shape[:2]
    image = bpy.data.images.get(name)
    if image is None or image.size[:] != (width, height):
        if image is not None:
            bpy.data.images.remove(image)
        image = bpy.data.images.new(name, width, height)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = picture[::-1].astype(np.float32) / 255
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def _open_editor(context: bpy.types.Context) -> bpy.types.Area | None:
    areas = (area for window in context.window_manager.windows for area in window.screen.areas)
    return next((area for area in areas if area.type == "IMAGE_EDITOR"), None)


def _split(context: bpy.types.Context) -> bpy.types.Area | None:
    """A new image editor beside the 3D view."""
    window = context.window or context.window_manager.windows[0]
    areas = window.screen.areas
    views = [area for area in areas if area.type == "VIEW_3D"]
    if not views:
        return None
    view, before = max(views, key=lambda a: a.width * a.height), set(areas)
    with context.temp_override(window=window, area=view, region=view.regions[-1]):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    # the new area is the left one: the sidebar with the panel stays where it is
    new = next(area for area in areas if area not in before)
    new = min((new, view), key=lambda a: a.x)
    new.type = "IMAGE_EDITOR"
    return new
