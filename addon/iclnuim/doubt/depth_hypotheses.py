"""Hypotheses on depth images that do not agree with their poses, and what each of them says."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.scene_axes import UNITS_M
from ..geometry.se3 import SE3
from .change import Change
from .hypothesis import Words
from .posed_depth import DepthHypothesis

#: Factors of positions, frames of a shift, and focal lengths from which fits start.
_FACTORS = np.arange(-4, 4.1, 0.2)
_SHIFTS = (-15, -11, -8, -6, -4, -3, -2, -1, -0.5, 0.5, 1, 2, 3, 4, 6, 8, 11, 15)
_FOCALS = np.linspace(-0.4, 0.4, 9)
#: A shift this near a number of frames may be that number.
WHOLE = 0.1
#: Ratios of the resolution of images to that of their camera's file.
_RESOLUTIONS = (0.25, 0.5, 2 / 3, 1.5, 2.0, 4.0)
#: Axes x, y, z of the body whose poses a file may have, and the name of the convention.
_BODIES = (
    ("right", "up", "backward", "OpenGL, Blender"),
    ("left", "down", "backward", ""),
    ("left", "up", "forward", "upside down"),
    ("forward", "right", "down", "NED"),
    ("forward", "left", "up", "FLU"),
    ("right", "forward", "up", ""),
    ("down", "left", "forward", "portrait"),
    ("up", "right", "forward", "portrait"),
    ("left", "down", "forward", ""),
    ("right", "up", "forward", "ICL-NUIM, Unity"),
    ("right", "down", "backward", ""),
    ("left", "up", "backward", ""),
    ("forward", "right", "up", "Unreal"),
)
#: The directions in the frame of the cv camera.
_DIRECTIONS = {
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "down": (0, 1, 0),
    "up": (0, -1, 0),
    "forward": (0, 0, 1),
    "backward": (0, 0, -1),
}
#: A camera that does not move.
STILL = Change("still", lambda T: SE3.identity((len(T),)))


def hypotheses(camera: PinholeCamera, depth_m: float) -> list[DepthHypothesis]:
    """All hypotheses, in the order in which mistakes are undone; depth_m: the usual depth."""
    found = [_fixed(change) for change in conventions()]
    frames = np.array(_SHIFTS)[:, None]
    found.append(DepthHypothesis("shifted", _shifted, frames, np.array([0.05])))
    found.append(DepthHypothesis("unit", _times, _FACTORS[:, None], np.array([0.005])))
    arm_step = np.full(3, 0.005 * depth_m)  # of poses in the unit of depth
    found.append(DepthHypothesis("arm", with_arm, np.zeros((1, 3)), arm_step))
    found += [_fixed(of_camera(other)) for other in other_cameras(camera)]

    def focal(x: np.ndarray) -> Change:
        factor = float(10 ** x[0])
        return of_camera(replace(camera, fx=factor * camera.fx, fy=factor * camera.fy), 1)

    def centre(x: np.ndarray) -> Change:
        return of_camera(replace(camera, cx=camera.cx + x[0], cy=camera.cy + x[1]), 2)

    found.append(DepthHypothesis("camera", focal, _FOCALS[:, None], np.array([0.005])))
    pixel = np.full(2, 0.003 * camera.width)
    found.append(DepthHypothesis("camera", centre, np.zeros((1, 2)), pixel))
    return found


def _fixed(change: Change) -> DepthHypothesis:
    return DepthHypothesis("axes" if change.kind == "mirrored" else change.kind, lambda x: change)


def conventions() -> list[Change]:
    """What a file's conventions may be, without a parameter."""
    found = [Change("quaternion", _scalar_first), Change("inverse", SE3.inverse)]
    found += [_of_body(*body) for body in _BODIES]
    return [*found, Change("ray", lambda images: images.along_rays(), "images")]


def _scalar_first(T: SE3) -> SE3:
    """The poses if the four numbers that were read as qx qy qz qw are qw qx qy qz."""
    return SE3.from_quat_xyzw(np.roll(T.quat_xyzw, -1, axis=-1), T.translation)


def _of_body(x: str, y: str, z: str, convention: str) -> Change:
    """Poses of a body whose axes have these directions; left-handed ones are mirrored."""
    body = np.array([_DIRECTIONS[axis] for axis in (x, y, z)], float).T

    def turned(T: SE3) -> SE3:
        return SE3(body @ T.rotation @ body.T, T.translation @ body.T)

    kind = "axes" if np.linalg.det(body) > 0 else "mirrored"
    name = f" ({convention})" if convention else ""
    return Change(kind, turned, parameters={"axes": f"x {x}, y {y}, z {z}{name}"})


def with_arm(arm_m: np.ndarray) -> Change:
    """Poses of a body, in whose frame the camera is at (3,)."""
    arm = SE3(np.eye(3), arm_m)
    return Change("arm", lambda T: T @ arm, parameters={"arm_m": _digits(arm_m, 3)}, free=3)


def scaled(factor: float) -> Change:
    """The positions multiplied by a factor; the same as depth divided by it."""
    (short,) = _digits([factor], 5)

    def change(T: SE3) -> SE3:
        return SE3(T.rotation, factor * T.translation)

    return Change("unit", change, parameters={"factor": short}, free=1)


def _times(decade: np.ndarray) -> Change:
    return scaled(float(10 ** decade[0]))


def _shifted(x: np.ndarray) -> Change:
    return shifted(float(x[0]))


def shifted(frames: float) -> Change:
    """Poses of so many frames later, between those of the frames; NaN beyond the ends."""
    frames = round(frames, 3)

    def change(T: SE3) -> SE3:
        at = np.arange(len(T)) + frames
        inside = (at >= 0) & (at <= len(T) - 1)
        first = np.clip(np.floor(at).astype(int), 0, max(len(T) - 2, 0))
        found = T[first].interpolate(T[np.minimum(first + 1, len(T) - 1)], at - first)
        return SE3(found.rotation, np.where(inside[:, None], found.translation, np.nan))

    return Change("shifted", change, parameters={"frames": frames}, free=1)


def of_camera(camera: PinholeCamera, free: int = 0) -> Change:
    """Images of another camera of the same size."""
    values = _digits([camera.fx, camera.fy, camera.cx, camera.cy], 5)
    parameters = dict(zip(("fx", "fy", "cx", "cy"), values, strict=True))
    return Change("camera", lambda images: images.seen_by(camera), "images", parameters, free)


def other_cameras(camera: PinholeCamera) -> list[PinholeCamera]:
    """Usual mistakes of a camera's file: that of another resolution, of the turned image, and the
    centre of the image in place of the principal point.
    """
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    centre = (camera.width - 1) / 2, (camera.height - 1) / 2
    found = [(fy, fx, cy, cx), (fx, fy, cy, cx), (fx, fy, *centre)]
    for scale in _RESOLUTIONS:
        found.append((scale * fx, scale * fy, scale * (cx + 0.5) - 0.5, scale * (cy + 0.5) - 0.5))
    changed = [replace(camera, fx=a, fy=b, cx=c, cy=d) for a, b, c, d in found]
    return [other for other in changed if other != camera]


def _digits(values: Sequence[float] | np.ndarray, digits: int) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in values]


#: Depth units per metre of known data sets and sensors: metres, centimetres, Middlebury and
#: Matterport, ICL-NUIM and TUM, ScanNet and Replica.
_DEPTH_UNITS = (1.0, 100.0, 256.0, 1000.0, 4000.0, 5000.0, 6553.5, 10000.0)
#: Units of length in metres that positions may have by mistake.
_POSE_UNITS = {unit: UNITS_M[unit] for unit in ("mm", "cm", "in", "ft")}
#: A known unit is named if the measured ratio differs from it by less.
_KNOWN = 0.01
#: Medians of depth in metres indoors.
_USUAL_DEPTH_M = (0.25, 25.0)
#: Formats of trajectories with other axes, by the name of the convention.
_FORMATS = {"NED": "tartanair", "ICL-NUIM": "gt.freiburg"}


class Depth(NamedTuple):
    """The depth as read: its units per metre, and its median in metres."""

    units_per_metre: float
    median_m: float


def _of_ray(change: Change, depth: Depth) -> Words:
    return Words(
        "if depth is the distance along the ray",
        "",
        "depth along the optical axis: divide it by the length of the ray (x, y, 1)",
    )


def _of_inverse(change: Change, depth: Depth) -> Words:
    return Words("with the poses inverted, as world to camera", "", "the format tum-inverse")


def _of_quaternion(change: Change, depth: Depth) -> Words:
    return Words("with quaternions qw qx qy qz, the scalar first", "", "the format tum-wxyz")


def _of_axes(change: Change, depth: Depth) -> Words:
    axes = change.parameters["axes"]
    handedness = "left-handed " * (change.kind == "mirrored")
    means = f"with the poses of a {handedness}camera with axes {axes}"
    known = [format for convention, format in _FORMATS.items() if convention in axes]
    advice = (
        f"the format {known[0]}" if known else "poses of a camera with x right, y down, z forward"
    )
    return Words(means, "", advice)


def _of_shift(change: Change, depth: Depth) -> Words:
    frames = change.parameters["frames"]
    count = f"{abs(frames):g} frame{'s' * (abs(frames) != 1)}"
    which = "later" if frames > 0 else "earlier"
    advice = "poses in the order of their images"
    if frames % 1:
        advice = "the stamps of depth and of poses: one clock is beside the other"
    return Words(f"with the poses of {count} {which}", "", advice)


def _of_arm(change: Change, depth: Depth) -> Words:
    arm = ", ".join(f"{value:g}" for value in change.parameters["arm_m"])
    means = f"with a lever arm, the camera at ({arm}) m on the body whose poses these are"
    return Words(means, "", "poses of the camera itself")


def _of_camera(change: Change, depth: Depth) -> Words:
    values = ",".join(f"{value:g}" for value in change.parameters.values())
    advice = "the camera of these images: its focal lengths and principal point"
    return Words(f"with the camera fx,fy,cx,cy {values}", "", advice)


def _of_unit(change: Change, depth: Depth) -> Words:
    """The unit of depth or that of the poses, whichever is known; of two known ones that of depth
    if the depth as read is unusual.
    """
    factor = change.parameters["factor"]
    near, far = _USUAL_DEPTH_M
    per_metre = depth.units_per_metre
    units = _nearest(_DEPTH_UNITS, per_metre * factor)
    unit_m = _nearest(tuple(_POSE_UNITS.values()), factor)
    if units and (not unit_m or not near <= depth.median_m <= far):
        means = f"with {units:g} depth units per metre instead of {per_metre:g}"
        return Words(means, "", f"{{units}} {units:g}, or positions times {factor:.4g}")
    if unit_m:
        name = next(name for name, metres in _POSE_UNITS.items() if metres == unit_m)
        return Words(f"with positions in {name}", "", f"positions times {unit_m:g}")
    means = f"with positions times {factor:.4g}, or depth divided by it"
    return Words(means, "", f"the right scale of the poses, or {{units}} {per_metre * factor:.5g}")


def _of_either(change: Change, depth: Depth) -> Words:
    unit, arm = _of_unit(change, depth), _of_arm(change, depth)
    return Words(f"{unit.better}, or {arm.better}", "", f"{unit.advice}, or {arm.advice}")


def _nearest(known: Sequence[float], value: float) -> float:
    """The known value within a hundredth, 0 if there is none."""
    return next((one for one in known if abs(value / one - 1) <= _KNOWN), 0.0)


#: What each kind says.
WORDS: dict[str, Callable[[Change, Depth], Words]] = {
    "unit": _of_unit,
    "ray": _of_ray,
    "inverse": _of_inverse,
    "quaternion": _of_quaternion,
    "axes": _of_axes,
    "mirrored": _of_axes,
    "shifted": _of_shift,
    "arm": _of_arm,
    "camera": _of_camera,
    "either": _of_either,
}
