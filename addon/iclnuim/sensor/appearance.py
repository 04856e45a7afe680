"""What a depth sensor sees besides the distance: how bright surfaces are and how they are turned.

A rendered frame has no infrared image. The luminance of its scene-linear light, by that of a white
surface, stands for the reflectance, so a shadow counts as a darker surface. Give `albedo` where it
is known.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from . import depth_image as images
from .transfer import linear_from_srgb8

#: Luminance of scene-linear RGB (ITU-R BT.709-6, item 3.2).
_LUMINANCE = (0.2126, 0.7152, 0.0722)
#: Light at and above this is saturated: 1 is white, the largest value of an 8-bit image.
_WHITE = 1.0
#: Diffuse reflectance of a white wall, the target of data sheets.
WHITE_ALBEDO = 0.95
#: Differences of infinite light would be no numbers.
_BRIGHTEST = np.float32(np.finfo(np.float16).max)


@dataclass(frozen=True)
class SurfaceAppearance:
    """`brightness`: luminance (h, w), 1 = white. `saturated`: whether it is white or brighter (h,
    w). `albedo`: diffuse reflectance (h, w), 0..1, or None: of the brightness. `normals`: (h, w, 3)
    unit vectors in the camera's frame (x right, y down, z forward), or None: normals of the depth
    image.
    """

    brightness: np.ndarray
    saturated: np.ndarray
    albedo: np.ndarray | None = None
    normals: np.ndarray | None = None

    @classmethod
    def of_light(cls, light: np.ndarray) -> "SurfaceAppearance":
        """Of scene-linear RGB (h, w, 3), or sRGB (h, w, 3) uint8. NaN is black. Raises InputError
        for other shapes and whole numbers.
        """
        if light.ndim != 3 or light.shape[2] != 3:
            raise InputError("colour (h, w, 3)", found=light.shape)
        if light.dtype.kind != "f" and light.dtype != np.uint8:
            raise InputError("colour as floating-point numbers or uint8", found=light.dtype)
        light = linear_from_srgb8(light) if light.dtype == np.uint8 else light
        red, green, blue = (
            light[..., k].astype(np.float32) * np.float32(_LUMINANCE[k]) for k in range(3)
        )
        brightness = np.clip(np.nan_to_num(red + green + blue), 0, _BRIGHTEST)
        return cls(brightness, brightness >= _WHITE)

    @classmethod
    def given(
        cls,
        shape: tuple[int, ...],
        rgb: np.ndarray | None = None,
        albedo: np.ndarray | float | None = None,
        normals: np.ndarray | None = None,
    ) -> "SurfaceAppearance | None":
        """Of arrays of an image of `shape` (h, w); a number as `albedo` is that of all surfaces.
        None if there is neither colour nor albedo. Raises InputError for another shape.
        """
        if rgb is None and albedo is None:
            return None
        known = None if albedo is None else _checked(albedo, shape)
        if rgb is not None:
            of_rgb = cls.of_light(np.asarray(rgb))
            brightness, saturated = of_rgb.brightness, of_rgb.saturated
        else:
            brightness = np.zeros(shape, np.float32) if known is None else known
            saturated = np.zeros(shape, bool)
        if normals is not None:
            normals = np.asarray(normals, np.float32)
        for name, image, expected in (
            ("colour", brightness, shape),
            ("albedo", known, shape),
            ("normals", normals, (*shape, 3)),
        ):
            if image is not None and image.shape != expected:
                raise InputError(f"{name} of the depth's size {expected}", found=image.shape)
        return cls(brightness, saturated, known, normals)

    def reflectance(self, illumination: float) -> np.ndarray:
        """The albedo (h, w); if it is not given, the brightness by that of a white surface, at most
        1.
        """
        if self.albedo is not None:
            return self.albedo
        return np.minimum(self.brightness / np.float32(illumination), np.float32(1))

    def cosine(self, depth_z_m: np.ndarray, camera: PinholeCamera) -> np.ndarray:
        """Cosine of the angle between normal and camera ray (h, w); 0 where there is no normal."""
        if self.normals is None:
            return 1 / images.surface_normals(depth_z_m, camera).secant
        x, y = images.ray_slopes(camera)
        along = self.normals[..., 0] * x + self.normals[..., 1] * y + self.normals[..., 2]
        return np.abs(along) / np.sqrt(1 + x * x + y * y)


def _checked(albedo: np.ndarray | float, shape: tuple[int, ...]) -> np.ndarray:
    """As an image. Raises InputError for values outside 0..1."""
    known = np.asarray(albedo, np.float32)
    if not ((known >= 0) & (known <= 1)).all():
        raise InputError("albedo in 0..1", found=f"{known.min():g} to {known.max():g}")
    return np.full(shape, known, np.float32) if known.ndim == 0 else known


def required(appearance: SurfaceAppearance | None, model: str) -> SurfaceAppearance:
    """The appearance. Raises InputError for a model that cannot do without."""
    if appearance is None:
        hint = "rgb=..., or albedo=0.5 for surfaces that are all alike"
        raise InputError(f"colour or albedo for the depth noise {model}", found="none", hint=hint)
    return appearance
