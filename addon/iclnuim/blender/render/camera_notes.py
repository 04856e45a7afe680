"""What the camera of the open scene has besides poses and one lens: its trajectory and its pinhole
camera do not contain it.
"""

from collections.abc import Mapping

import numpy as np
from bpy.types import Object, Scene

from ..notes import names_of
from ..open import motion
from .camera import active, pinhole

#: Larger relative changes of the intrinsics are another lens.
_SAME = 1e-6
#: Larger cosines between the axes of a camera are a shear: at 1e-4 an image is off by less than a
#: tenth of a pixel at its edge, and float32 matrices are a hundred times better.
_SHEAR = 1e-4
#: Settings by their place below the scene: what they are, and the value without an effect.
_NEUTRAL: Mapping[str, tuple[str, object]] = {
    "camera.data.dof.use_dof": ("depth of field", False),
    "render.use_motion_blur": ("motion blur", False),
    "cycles.rolling_shutter_type": ("rolling shutter", "NONE"),
    "render.use_border": ("render region", False),
    "render.use_multiview": ("stereoscopy", False),
    "frame_step": ("frame step", 1),
}


def camera_notes(scene: Scene, camera: Object | None = None) -> list[str]:
    """The findings, one sentence each, about the trajectory of the camera, or of the active one."""
    notes = []
    cameras = _in_use(scene, camera)
    if len(cameras) > 1:
        switched = f"markers of the timeline switch between cameras ({names_of(cameras)})"
        notes.append(f"{switched}: the poses jump from one to the other")
    other = [thing for thing in cameras if thing.data.type != "PERSP"]
    if other:
        kinds = f"{names_of(other)}: {other[0].data.type}"
        notes.append(f"the camera is not a perspective one ({kinds}): its images are not those")
    elif len(cameras) > 1 or motion.varies(cameras[0].data):
        notes += _lens_notes(scene, camera)
    if sheared := [thing for thing in cameras if _is_sheared(thing)]:
        by = "by the scales of its parents: its poses are rotations without that"
        notes.append(f"the camera is sheared ({names_of(sheared)}) {by}, and images differ")
    unused = []
    for place, (what, neutral) in _NEUTRAL.items():
        if _has(scene, place, neutral):
            unused.append(what)
    if unused:
        notes.append(f"settings of the scene that are not applied: {', '.join(unused)}")
    return notes


def _is_sheared(camera: Object) -> bool:
    """Whether its axes are not at right angles in the world, as no rotation leaves them."""
    axes = np.array(camera.matrix_world)[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    cosines = (axes.T @ axes) / np.maximum(np.outer(lengths, lengths), 1e-30)
    return bool(np.abs(cosines - np.diag(np.diag(cosines))).max() > _SHEAR)


def _in_use(scene: Scene, camera: Object | None) -> list[Object]:
    """The cameras that the timeline shows, in the order of time."""
    if camera is not None:
        return [camera]
    bound = [marker for marker in scene.timeline_markers if marker.camera]
    bound.sort(key=lambda marker: marker.frame)
    if not bound:
        return [active(scene)]
    # before the first marker Blender shows the camera of the first one
    first = [marker for marker in bound if marker.frame <= scene.frame_start][-1:] or bound[:1]
    later = [marker for marker in bound if scene.frame_start < marker.frame <= scene.frame_end]
    return list(dict.fromkeys(marker.camera for marker in first + later))


def _lens_notes(scene: Scene, camera: Object | None) -> list[str]:
    """A sentence if the intrinsics change along the timeline. The current frame is restored."""
    before = scene.frame_current
    intrinsics = []
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        lens = pinhole(scene, camera or active(scene))
        if lens is not None:
            intrinsics.append(lens.intrinsics)
    scene.frame_set(before)
    values = np.array(intrinsics)
    low = values.min(axis=0)
    high = values.max(axis=0)
    if np.allclose(low, high, rtol=_SAME, atol=0):
        return []
    lengths = f"focal length from {low[0]:.4g} to {high[0]:.4g} pixels"
    return [f"the camera's lens changes along the timeline ({lengths}): frames have one lens"]


def _has(scene: Scene, place: str, neutral: object) -> bool:
    """Whether the scene has another value in that place, if it has the place at all."""
    value: object = scene
    for name in place.split("."):
        value = getattr(value, name, None)
    return value is not None and value != neutral
