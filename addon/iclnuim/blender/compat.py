"""Every difference between Blender versions, one function a difference. Each asks for the feature, not for the version."""

from __future__ import annotations

import bpy

from ..errors import InputError

OLDEST = (4, 2, 0)


def require_supported_version() -> None:
    """Raises InputError below Blender 4.2."""
    if bpy.app.version < OLDEST:
        raise InputError("Blender 4.2 or newer", found=f"Blender {bpy.app.version_string}", hint="4.5 LTS or 5.2 LTS")


def version_line() -> str:
    """`4.5.3 LTS (hash)`: what tells one build from another."""
    return f"{bpy.app.version_string} ({bpy.app.build_hash.decode(errors='replace')})"


def set_multilayer_exr(image_settings: bpy.types.ImageFormatSettings) -> None:
    """32-bit float multilayer EXR, not compressed. From 5.0 on the kind of medium is chosen before the format."""
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"
    image_settings.color_depth = "32"
    image_settings.exr_codec = "NONE"


def fcurves(datablock: bpy.types.ID, action: bpy.types.Action):
    """The F-curves of `action` for `datablock`. From 4.4 on they lie in layers, strips and channel bags, under a slot."""
    animation = datablock.animation_data_create()
    animation.action = action
    if not hasattr(action, "slots"):
        return action.fcurves
    slot = action.slots[0] if len(action.slots) else action.slots.new(id_type=datablock.id_type, name=datablock.name)
    animation.action_slot = slot
    layer = action.layers[0] if len(action.layers) else action.layers.new("Layer")
    strip = layer.strips[0] if len(layer.strips) else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True).fcurves


def has_denoiser() -> bool:
    """Whether this build carries OpenImageDenoise (Debian's do not)."""
    try:
        import _cycles

        return bool(getattr(_cycles, "with_openimagedenoise", False))
    except ImportError:
        return False
