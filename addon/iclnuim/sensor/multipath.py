"""Light that reaches a time-of-flight camera over a second surface: a longer way, so that corners
are measured too far and are rounded.
"""

import numpy as np

from ..geometry.camera import PinholeCamera
from . import depth_image as images

#: Patches in a row of the coarse image: the time grows with the fourth power.
_PATCHES = 32
#: Cosines of the device's light are at least this: a patch at a grazing angle is not larger than
#: ten times its cross-section.
_MIN_COSINE = 0.1


def longer_way_m(
    depth_z_m: np.ndarray,
    camera: PinholeCamera,
    albedo: np.ndarray,
    radians_per_m: float,
    strength: float,
) -> np.ndarray:
    """Error of the distance (h, w) in metres from one bounce between diffuse surfaces.

    The device lights patch j, which lights patch i. The ratio of that light to the device's own on
    patch i is albedo_j E_j F_ij / E_i with the irradiance E = cos / r^2 and the form factor F_ij =
    cos_i cos_j area_j / (pi d^2); its way is (r_j + d - r_i) / 2 longer, never shorter. Both are
    added as phasors. All patches are taken to see each other if they face each other.
    """
    height, width = depth_z_m.shape
    step = max(1, -(-width // _PATCHES))
    rows = np.arange(step // 2, height, step)
    columns = np.arange(step // 2, width, step)
    if min(len(rows), len(columns)) < 2:
        return np.zeros_like(depth_z_m)
    coarse = PinholeCamera(
        width=len(columns),
        height=len(rows),
        fx=camera.fx / step,
        fy=camera.fy / step,
        cx=(camera.cx - step // 2) / step,
        cy=(camera.cy - step // 2) / step,
    )
    grid = np.ix_(rows, columns)
    error_m = _between_patches(
        depth_z_m[grid], coarse, strength * albedo[grid], np.float32(radians_per_m)
    )
    error_m = _interpolated(error_m, rows, height)
    error_m = _interpolated(error_m.T, columns, width).T
    return error_m * (depth_z_m > 0)


def _between_patches(
    depth_z_m: np.ndarray, camera: PinholeCamera, albedo: np.ndarray, radians_per_m: np.float32
) -> np.ndarray:
    x, y = images.ray_slopes(camera)
    ray_length = np.sqrt(1 + x * x + y * y)
    found = images.surface_normals(depth_z_m, camera)
    has_normal = (depth_z_m > 0) & np.isfinite(found.secant)
    cosine = np.where(has_normal, np.maximum(1 / found.secant, np.float32(_MIN_COSINE)), 1)
    range_m = np.where(has_normal, depth_z_m * ray_length, np.float32(1))
    irradiance = cosine / range_m**2
    area_m2 = range_m**2 / (ray_length**3 * np.float32(camera.fx * camera.fy) * cosine)
    sent = np.where(has_normal, albedo * irradiance * area_m2 / np.float32(np.pi), np.float32(0))
    points = [(depth_z_m * slope).ravel() for slope in (x, y, np.float32(1))]
    length = np.sqrt(found.x**2 + found.y**2 + found.z**2)
    with np.errstate(invalid="ignore"):
        # towards the camera
        normals = [
            np.where(has_normal, -n / length, 0).ravel() for n in (found.x, found.y, found.z)
        ]
    apart = [p[None] - p[:, None] for p in points]
    distance2 = sum(d * d for d in apart)
    here = sum(n[:, None] * d for n, d in zip(normals, apart, strict=True))
    there = -sum(n[None] * d for n, d in zip(normals, apart, strict=True))
    facing = np.maximum(here, 0) * np.maximum(there, 0)
    # the area keeps neighbouring patches, whose distance is not small for their size, finite
    nearest2 = distance2 + area_m2.ravel()[None]
    ratio = sent.ravel()[None] * facing / (nearest2 * nearest2 * irradiance.ravel()[:, None])
    longer_m = (range_m.ravel()[None] + np.sqrt(distance2) - range_m.ravel()[:, None]) / 2
    phase = radians_per_m * longer_m
    sine = (ratio * np.sin(phase)).sum(1)
    cosines = (ratio * np.cos(phase)).sum(1)
    error_m = np.arctan2(sine, 1 + cosines) / radians_per_m
    return np.where(has_normal.ravel(), error_m, 0).reshape(depth_z_m.shape).astype(np.float32)


def _interpolated(values: np.ndarray, places: np.ndarray, count: int) -> np.ndarray:
    """Rows at `places` -> `count` rows, linear between them and constant outside."""
    position = np.interp(np.arange(count), places, np.arange(len(places))).astype(np.float32)
    below = np.minimum(position.astype(np.intp), len(places) - 2)
    weight = (position - below)[:, None]
    return values[below] + (values[below + 1] - values[below]) * weight
