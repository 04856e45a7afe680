"""Alignment of an estimated trajectory with the reference (origin, yaw only, SE(3), Sim(3)), and
detection of undetermined alignments.

Least squares after Umeyama, "Least-squares estimation of transformation parameters between two
point patterns", PAMI 1991 (equation numbers below). For SE(3) this is the same minimum as Horn,
"Closed-form solution of absolute orientation using unit quaternions", JOSA A 1987. x are the
positions of the estimate, y those of the reference, both (n, 3) in metres and already paired.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.se3 import SE3, read_only
from ..settings import Settings, setting

METHODS = {
    "none": "both are in the same world",
    "origin": "the first poses are made equal",
    "yaw": "rotation about the up axis, and translation",
    "se3": "rotation and translation",
    "sim3": "rotation, translation and scale",
}
#: A trajectory whose extent in a direction is below this, or below this share of its longest
#: extent, does not determine a rotation: files have a resolution of about 0.1 mm, and the tremor of
#: a hand is of millimetres.
MIN_EXTENT_M = 1e-4
MIN_EXTENT_SHARE = 1e-3
_MIN_MIRROR_POSES = 10


@dataclass(frozen=True)
class AlignmentSettings(Settings):
    """Alignment of the estimate with the reference before absolute errors are computed."""

    group = "alignment settings"

    method: str = setting(
        "se3", "alignment of the estimate", choices=METHODS, option="--align", label="Alignment"
    )
    first: int | None = setting(
        None,
        "align on the first N pairs only; default: all",
        low=1,
        option="--align-first",
        label="First Pairs",
    )
    up: str = setting(
        "z", "axis that yaw rotates about", choices=dict.fromkeys("xyz", ""), label="Yaw Axis"
    )


@dataclass(frozen=True, eq=False)
class Alignment:
    """p_reference = scale * R p_estimate + t, with (R, t) = T_reference_estimate.

    extents_m (3,): standard deviations of the reference's positions along their principal
    directions, longest first, over the `poses_used` first pairs. residual_rms_m: RMS distance of
    those pairs after the alignment.
    """

    method: str
    T_reference_estimate: SE3
    scale: float
    poses_used: int
    extents_m: np.ndarray
    residual_rms_m: float

    def apply(self, poses: SE3) -> SE3:
        """Estimated poses (n,) in the reference's world."""
        return self.T_reference_estimate @ SE3(poses.rotation, self.scale * poses.translation)

    @property
    def rotation_is_noise(self) -> bool:
        """Whether the second extent is below the remaining error: the rotation about the
        trajectory's line then only depends on the error.
        """
        return self.method in ("se3", "sim3") and self.residual_rms_m > self.extents_m[1]


@dataclass(frozen=True)
class MirrorCheck:
    """The RMS errors after the best rotation and after the best reflection, and the extent of the
    reference.
    """

    rotation_rms_m: float = 0.0
    reflection_rms_m: float = 0.0
    extent_m: float = 0.0

    @property
    def mirrored(self) -> bool:
        """Whether a reflection fits much better: its squared error is below a quarter of the
        rotation's, which is above rounding.
        """
        fits = self.reflection_rms_m < 0.25 * self.extent_m
        return (
            fits
            and self.rotation_rms_m > MIN_EXTENT_M
            and self.reflection_rms_m < 0.5 * self.rotation_rms_m
        )


def align(reference: SE3, estimate: SE3, settings: AlignmentSettings | None = None) -> Alignment:
    """The transformation that aligns associated estimated poses (n,) with the reference's (n,).

    Raises InputError if it is undetermined, because there are too few poses, or the trajectory is
    straight or does not move. The hint is an alignment that needs less.
    """
    settings = settings or AlignmentSettings()
    if reference.shape != estimate.shape or len(reference) == 0:
        found = f"{estimate.shape} and {reference.shape}"
        raise InputError("as many estimated poses as reference poses, at least one", found=found)
    used = slice(None, settings.first)
    x = estimate.translation[used]
    y = reference.translation[used]
    extents_m = principal_extents(y)
    T = SE3.identity()
    scale = 1.0
    if settings.method == "origin":
        T = reference[0] @ estimate[0].inverse()
    elif settings.method == "yaw":
        T = _yaw(x, y, "xyz".index(settings.up))
    elif settings.method in ("se3", "sim3"):
        _refuse_undetermined(extents_m, principal_extents(x), len(x), settings.method)
        T, scale = umeyama(x, y, with_scale=settings.method == "sim3")
    residual_m = y - T.apply(scale * x)
    return Alignment(settings.method, T, scale, len(x), extents_m, _rms(residual_m))


def umeyama(
    x: np.ndarray, y: np.ndarray, with_scale: bool = False, reflect: bool = False
) -> tuple[SE3, float]:
    """The rotation R, translation t and scale c (1 without `with_scale`) that minimise |y - (c R x
    + t)|^2.

    With `reflect`, the best improper R (determinant -1) instead; the SE3 that contains it is not a
    rigid motion.
    """
    # equations 34, 35
    mean_x = x.mean(axis=0)
    mean_y = y.mean(axis=0)
    centred_x = x - mean_x
    centred_y = y - mean_y
    covariance = centred_y.T @ centred_x / len(x)  # equation 38
    u, d, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    if reflect:
        sign = -sign
    # equation 43; equation 39 with the sign taken from U and V holds at rank 2 too
    s = np.array([1.0, 1.0, sign])
    rotation = (u * s) @ vt  # equation 40
    scale = 1.0
    if with_scale:  # equations 42, 36
        scale = float(d @ s / (np.vdot(centred_x, centred_x) / len(x)))
    return SE3(rotation, mean_y - scale * rotation @ mean_x), scale  # equation 41


def check_mirror(reference_m: np.ndarray, estimate_m: np.ndarray) -> MirrorCheck:
    """Fit paired positions (n, 3) by a rotation and by a reflection, both with scale: only the
    handedness differs.

    A trajectory in a plane fits both equally well and is never reported as mirrored. Neither is one
    of a few poses, which can fit by chance.
    """
    if len(reference_m) < _MIN_MIRROR_POSES or principal_extents(estimate_m)[0] == 0.0:
        return MirrorCheck()
    T, scale = umeyama(estimate_m, reference_m, with_scale=True)
    rotation_m = _rms(reference_m - T.apply(scale * estimate_m))
    T, scale = umeyama(estimate_m, reference_m, with_scale=True, reflect=True)
    reflection_m = _rms(reference_m - T.apply(scale * estimate_m))
    extent_m = float(np.linalg.norm(principal_extents(reference_m)))
    return MirrorCheck(rotation_m, reflection_m, extent_m)


def principal_extents(positions_m: np.ndarray) -> np.ndarray:
    """(n, 3) -> (3,) standard deviations along the principal directions, longest first."""
    centred = positions_m - positions_m.mean(axis=0)
    return read_only(
        np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred / len(centred))[::-1], 0.0))
    )


def _yaw(x: np.ndarray, y: np.ndarray, up: int) -> SE3:
    """Rotation about the axis `up`, and translation: equation 40 in the plane, in closed form."""
    a, b = (up + 1) % 3, (up + 2) % 3
    flat_x = x[:, (a, b)]
    flat_y = y[:, (a, b)]
    for name, extents_m in (
        ("a reference", principal_extents(flat_y)),
        ("an estimated", principal_extents(flat_x)),
    ):
        if extents_m[0] <= MIN_EXTENT_M:
            expected = f"{name} trajectory that determines a yaw alignment"
            across = f"moving across the {'xyz'[up]} axis"
            found = f"an extent of {1000 * extents_m[0]:.3g} mm"
            raise InputError(f"{expected}, {across}", found=found, hint="the alignment origin")
    mean_x = x.mean(axis=0)
    mean_y = y.mean(axis=0)
    covariance = (y - mean_y).T @ (x - mean_x)
    angle = np.arctan2(covariance[b, a] - covariance[a, b], covariance[a, a] + covariance[b, b])
    rotation = np.eye(3)
    rotation[a, a] = rotation[b, b] = np.cos(angle)
    rotation[b, a] = np.sin(angle)
    rotation[a, b] = -np.sin(angle)
    return SE3(rotation, mean_y - rotation @ mean_x)


def _refuse_undetermined(
    reference_m: np.ndarray, estimate_m: np.ndarray, used: int, method: str
) -> None:
    """Raise InputError unless both trajectories have extents in two directions; the third can be 0
    (a trajectory in a plane).
    """
    # for Sim(3) the estimate's unit of length is unknown, so only the ratio of its extents is
    # checked
    min_estimate_m = MIN_EXTENT_M if method == "se3" else 0.0
    both = (
        ("a reference", reference_m, MIN_EXTENT_M),
        ("an estimated", estimate_m, min_estimate_m),
    )
    for name, extents_m, min_m in both:
        if used < 3:
            found = f"{used} pose{'s' * (used > 1)} where 3 are needed"
            hint = "the alignment origin, or more poses"
        elif extents_m[0] <= min_m:
            found = "one that does not move, so its rotation is undetermined"
            hint = "the alignment origin"
        elif extents_m[1] <= max(min_m, MIN_EXTENT_SHARE * extents_m[0]):
            found = "a straight one, so the rotation about it is undetermined"
            hint = "the alignment yaw if it is not upright, or the alignment origin"
        else:
            continue
        sizes = ", ".join(f"{1000 * e:.3g}" for e in extents_m)
        expected = f"{name} trajectory that determines {'SE(3)' if method == 'se3' else 'Sim(3)'}"
        raise InputError(expected, found=f"{found} (extents {sizes} mm)", hint=hint)


def _rms(residual_m: np.ndarray) -> float:
    return float(np.sqrt(np.vdot(residual_m, residual_m) / len(residual_m)))
