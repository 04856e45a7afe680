"""Depth of a sequence against its poses: the frames that have both, and the verdict in words."""

from collections.abc import Callable, Sequence

import numpy as np

from ..doubt.depth_against_poses import Agreement, agreement
from ..errors import InputError, named
from ..geometry.scene_axes import UNITS_M
from ..geometry.trajectory import Trajectory, sample
from .camera_files import SequenceCamera
from .frames import ImagePair, depth_stamps_s, posed
from .stored_sequence import read_depth_m

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

TOO_LITTLE = "cannot be told from these frames: the camera moves too little"


def pose_agreement(
    pairs: Sequence[ImagePair], camera: SequenceCamera, poses: Trajectory
) -> Agreement:
    """Compare the depth of the pairs that have a pose with these poses. Images that cannot be read
    are left out.
    """
    within = [p for p in pairs if poses.stamps_s[0] <= p.depth_stamp_s <= poses.stamps_s[-1]]
    stamps_s = depth_stamps_s(within)
    if len(within) < 2 or len(poses) < 2:
        return Agreement()
    chosen = np.flatnonzero(posed(stamps_s, poses)).tolist()

    def load(frame: int) -> np.ndarray | None:
        try:
            return read_depth_m(within[chosen[frame]].depth, camera.depth_units_per_metre)
        except InputError:
            return None

    return agreement(load, sample(poses, stamps_s[chosen]), camera.pinhole)


def doubt(
    found: Agreement,
    camera: SequenceCamera,
    name_of: Callable[[str], str] = "depth_{}_per_metre".format,
) -> str:
    """What is wrong and what to try, in one sentence; "" if the poses are as they should be.

    name_of: the name of the setting `units`; by default that in camera.json.
    """
    if not found.doubtful:
        return ""
    measured = f"between images depth differs by {_percent(found.residual)}"
    if not found.reading.kind:
        return f"poses, depth and camera do not match: {measured} with the poses as read"
    means, hint = _meaning(found, camera)
    explained = f"by {_percent(found.explained)} {means}"
    return (
        f"poses and depth do not match: {measured} as read, {explained}; try {named(hint, name_of)}"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _meaning(found: Agreement, camera: SequenceCamera) -> tuple[str, str]:
    """What the explanation is, and what to try."""
    detail = found.reading.detail
    match found.reading.kind:
        case "unit":
            return _unit(float(detail), found.depth_m, camera.depth_units_per_metre)
        case "ray":
            planar = "depth along the optical axis: divide it by the length of the ray (x, y, 1)"
            return "if depth is the distance along the ray", planar
        case "inverse":
            return "with the poses inverted, as world to camera", "the format tum-inverse"
        case "quaternion":
            return "with quaternions qw qx qy qz, the scalar first", "the format tum-wxyz"
        case "shifted":
            return _shift(int(detail))
        case "arm":
            return _arm(detail)
        case "camera":
            means = f"with the camera fx,fy,cx,cy {detail}"
            return means, "the camera of these images: its focal lengths and principal point"
        case "either":
            factor, arm = detail.split(";")
            of_unit, hint = _unit(float(factor), found.depth_m, camera.depth_units_per_metre)
            return f"{of_unit}, or {_arm(arm)[0]}", f"{hint}, or {_arm(arm)[1]}"
    handedness = "left-handed " * (found.reading.kind == "mirrored")
    means = f"with the poses of a {handedness}camera with axes {detail}"
    for convention, format in _FORMATS.items():
        if convention in detail:
            return means, f"the format {format}"
    return means, "poses of a camera with x right, y down, z forward"


def _unit(factor: float, depth_m: float, units_per_metre: float) -> tuple[str, str]:
    """What a ratio of poses to depth means: the unit of depth or that of the poses, whichever is
    known; of two known ones that of depth if the depth as read is unusual.
    """
    near, far = _USUAL_DEPTH_M
    units = _nearest(_DEPTH_UNITS, units_per_metre * factor)
    unit_m = _nearest(tuple(_POSE_UNITS.values()), factor)
    if units and (not unit_m or not near <= depth_m <= far):
        means = f"with {units:g} depth units per metre instead of {units_per_metre:g}"
        return means, f"{{units}} {units:g}, or positions times {factor:.4g}"
    if unit_m:
        name = next(name for name, metres in _POSE_UNITS.items() if metres == unit_m)
        return f"with positions in {name}", f"positions times {unit_m:g}"
    means = f"with positions times {factor:.4g}, or depth divided by it"
    return means, f"the right scale of the poses, or {{units}} {units_per_metre * factor:.5g}"


def _arm(arm: str) -> tuple[str, str]:
    means = f"with a lever arm, the camera at ({arm}) m on the body whose poses these are"
    return means, "poses of the camera itself"


def _nearest(known: Sequence[float], value: float) -> float:
    """The known value within a hundredth, 0 if there is none."""
    return next((one for one in known if abs(value / one - 1) <= _KNOWN), 0.0)


def _shift(frames: int) -> tuple[str, str]:
    count = f"{abs(frames)} frame{'s' * (abs(frames) > 1)}"
    which = "later" if frames > 0 else "earlier"
    return f"with the poses of {count} {which}", "poses in the order of their images"
