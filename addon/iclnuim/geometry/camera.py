"""The pinhole camera, with pixel centres at integer indices, and the Blender settings that
reproduce it exactly.

Camera frame: cv (x right, y down, z forward). Depth is planar: z along the optical axis, in metres.
"""

import json
import math
import os
import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..errors import InputError, within
from ..settings import Settings, parameter

_EQUATION_1 = "paper, equation 1"
#: Keys of camera.json besides the camera's, where they have no effect on its rays.
_BESIDE = ("depth_units_per_metre",)
_CENTRE = "principal point, from the centre of the {} pixel"


@dataclass(frozen=True)
class PinholeCamera(Settings):
    """K = [fx 0 cx; 0 fy cy; 0 0 1] in pixels; the ray of pixel (u, v) is through its centre, u <
    width, v < height.

    The defaults are the benchmark's (paper, equation 1). Its printed fy = -480 means a y axis that
    points up; in cv axes it is +480. fx is POV-Ray's exact 640/1.33, printed as 481.20.
    """

    group: ClassVar[str] = "a camera"

    width: int = parameter(
        640, "width of the images", unit="px", low=1, high=65536, source=_EQUATION_1
    )
    height: int = parameter(
        480, "height of the images", unit="px", low=1, high=65536, source=_EQUATION_1
    )
    fx: float = parameter(
        640 / 1.33,
        "focal length along a row",
        unit="px",
        low=1e-3,
        source="POV-Ray; paper: 481.20",
        label="Focal Length fx",
    )
    fy: float = parameter(
        480.0,
        "focal length along a column",
        unit="px",
        low=1e-3,
        source="-480 in the paper: y up",
        label="Focal Length fy",
    )
    cx: float = parameter(
        319.5, _CENTRE.format("leftmost"), unit="px", source=_EQUATION_1, label="Centre cx"
    )
    cy: float = parameter(
        239.5, _CENTRE.format("topmost"), unit="px", source=_EQUATION_1, label="Centre cy"
    )

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if isinstance(value := getattr(self, name), float) and value.is_integer():
                object.__setattr__(self, name, int(value))
        if isinstance(self.fy, float | int) and self.fy < 0:
            hint = "its absolute value: a negative fy means that the y axis points up"
            raise InputError("a camera's fy > 0", found=self.fy, hint=hint)
        super().__post_init__()
        if min(self.fx, self.fy) < 1:
            found = f"fx {self.fx:g} and fy {self.fy:g}"
            hint = "pixels in place of shares of the image: fx times the width, fy times the height"
            raise InputError("focal lengths of at least a pixel", found=found, hint=hint)

    @classmethod
    def parse(cls, text: str) -> "PinholeCamera":
        """`WIDTHxHEIGHT,FX,FY,CX,CY`, the last four optional: by default the benchmark's view,
        scaled to the width. A negative FY, as the paper prints it, is a y axis that points up.
        """
        parts = text.strip().split(",")
        size = re.fullmatch(r"(\d{1,9})x(\d{1,9})", parts[0])
        if not size or len(parts) not in (1, 5):
            raise InputError("a camera as WIDTHxHEIGHT or WIDTHxHEIGHT,FX,FY,CX,CY", found=text)
        width, height = int(size[1]), int(size[2])
        if len(parts) == 1:
            scale = width / 640
            return cls(
                width, height, 640 / 1.33 * scale, 480.0 * scale, (width - 1) / 2, (height - 1) / 2
            )
        try:
            fx, fy, cx, cy = map(float, parts[1:])
        except ValueError:
            raise InputError("numbers for FX,FY,CX,CY", found=text) from None
        return cls(width, height, fx, abs(fy), cx, cy)

    @classmethod
    def from_K(cls, K: np.ndarray, width: int, height: int) -> "PinholeCamera":
        """From a camera matrix (3, 3) in pixels and the size of the images. A negative fy, as the
        paper prints it, is a y axis that points up.

        Raises InputError for another matrix, also for one with skew.
        """
        K = np.asarray(K, float)
        if K.shape != (3, 3) or K[0, 1] or K[1, 0] or K[2].tolist() != [0, 0, 1]:
            raise InputError("a camera matrix [fx 0 cx; 0 fy cy; 0 0 1]", found=K.tolist())
        return cls(width, height, K[0, 0], abs(K[1, 1]), K[0, 2], K[1, 2])

    @classmethod
    def from_fov(cls, width: int, height: int, horizontal_deg: float) -> "PinholeCamera":
        """Square pixels, the principal point in the middle of the image, and a horizontal field of
        view in degrees, from the left edge of the first pixel to the right edge of the last.

        Raises InputError for an angle that is not between 0 and 180 degrees.
        """
        if not 0 < horizontal_deg < 180:
            raise InputError("a field of view between 0 and 180 degrees", found=horizontal_deg)
        focal = width / 2 / math.tan(math.radians(horizontal_deg) / 2)
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "PinholeCamera":
        """The camera of a camera.json, as it stands in a sequence's folder.

        Raises InputError for a file without width, height, fx, fy, cx, cy, and for one with a
        distortion or anything else.
        """
        try:
            content = json.loads(Path(path).read_bytes())
        except OSError as error:
            raise InputError("a camera.json", path=path, found=error.strerror) from None
        except (ValueError, RecursionError) as error:
            raise InputError("a camera.json", path=path, found=f"no JSON: {error}") from None
        with within(path):
            if not isinstance(content, dict):
                raise InputError("a camera as a JSON object", found=content)
            camera = {key: value for key, value in content.items() if key not in _BESIDE}
            if missing := [f.name for f in fields(cls) if f.name not in camera]:
                raise InputError("a whole camera", found=f"no {', '.join(missing)}")
            return cls.from_dict(camera)

    @classmethod
    def of(cls, given: "CameraOrText") -> "PinholeCamera":
        """The camera, or the one that a text describes (`parse`). Raises InputError."""
        if isinstance(given, str):
            return cls.parse(given)
        if not isinstance(given, cls):
            hint = "'640x480,525,525,319.5,239.5', or PinholeCamera.from_K"
            raise InputError("a PinholeCamera or its text", found=type(given).__name__, hint=hint)
        return given

    @property
    def K(self) -> np.ndarray:
        """The camera matrix (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def intrinsics(self) -> np.ndarray:
        """(4,): fx, fy, cx, cy."""
        return np.array([self.fx, self.fy, self.cx, self.cy])

    def rays(self) -> np.ndarray:
        """(height, width, 3): the point at depth 1 behind each pixel centre, camera frame."""
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        rays = np.ones((self.height, self.width, 3))
        rays[..., 0] = x
        rays[..., 1] = y[:, None]
        return rays

    def unproject(self, depth_z_m: np.ndarray) -> np.ndarray:
        """(height, width) planar depth in metres -> (height, width, 3) points, camera frame."""
        depth_z_m = np.asarray(depth_z_m)
        size = (self.height, self.width)
        if depth_z_m.shape != size:
            raise InputError(f"a depth image of shape {size}", found=depth_z_m.shape)
        return self.rays() * depth_z_m[..., None]

    def project(self, points_camera: np.ndarray) -> np.ndarray:
        """(..., 3) points in the camera frame -> (..., 2) pixel coordinates (u, v); NaN where z <=
        0.
        """
        p = np.asarray(points_camera, float)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        return np.stack([self.fx * p[..., 0] / z + self.cx, self.fy * p[..., 1] / z + self.cy], -1)

    def resized(self, width: int, height: int) -> "PinholeCamera":
        """The camera of the same view with another number of pixels: cx' = (cx + 0.5) s - 0.5."""
        across, down = width / self.width, height / self.height
        cx = (self.cx + 0.5) * across - 0.5
        cy = (self.cy + 0.5) * down - 0.5
        return PinholeCamera(width, height, self.fx * across, self.fy * down, cx, cy)

    def narrowed(self, width: int) -> "PinholeCamera":
        """The camera of the same view with at most this number of columns, and rows in proportion."""
        width = min(width, self.width)
        return self.resized(width, max(2, round(self.height * width / self.width)))

    def halved(self) -> "PinholeCamera":
        """The camera of the next level of a 2x2-mean pyramid, defined at its pixel centres: cx' =
        (cx + 0.5)/2 - 0.5.
        """
        cx, cy = ((c + 0.5) / 2 - 0.5 for c in (self.cx, self.cy))
        return PinholeCamera(self.width // 2, self.height // 2, self.fx / 2, self.fy / 2, cx, cy)


def nearest_pixels(length: int, count: int) -> np.ndarray:
    """(count,) the nearest of `length` pixels to the centres of `count` equal parts of a row."""
    return ((np.arange(count) + 0.5) * length / count).astype(np.intp)


#: A camera, or its text `WIDTHxHEIGHT,FX,FY,CX,CY`.
CameraOrText = PinholeCamera | str

#: Blender's limits (the hard minimum and maximum of its properties resolution_x and
#: pixel_aspect_x).
MIN_RENDERED_PX = 4
MAX_PIXEL_ASPECT = 200


@dataclass(frozen=True)
class BlenderCamera:
    """Settings of a Blender perspective camera (lens in mm) and of the scene's render size."""

    resolution_x: int
    resolution_y: int
    pixel_aspect_x: float
    pixel_aspect_y: float
    lens: float
    sensor_width: float
    shift_x: float
    shift_y: float
    sensor_fit: str = "HORIZONTAL"


def blender_from_pinhole(camera: PinholeCamera) -> BlenderCamera:
    """The exact Blender settings for a K, also with fx != fy and an off-centre principal point.

    Blender's shifts are in units of the image width (horizontal fit). It has one focal length, so
    the ratio of fx and fy is set as the pixel aspect; both aspects have to be 1 or more. The sensor
    is wider for a lens that would be shorter than 1 mm, which Blender does not allow. Raises
    InputError for a camera beyond its other limits.
    """
    if min(camera.width, camera.height) < MIN_RENDERED_PX:
        found = f"{camera.width} x {camera.height}"
        raise InputError(
            f"images of at least {MIN_RENDERED_PX} x {MIN_RENDERED_PX} pixels, as Blender renders",
            found=found,
        )
    if not 1 / MAX_PIXEL_ASPECT <= camera.fx / camera.fy <= MAX_PIXEL_ASPECT:
        expected = f"focal lengths whose ratio is at most {MAX_PIXEL_ASPECT}, as Blender renders"
        raise InputError(expected, found=f"fx {camera.fx:g} and fy {camera.fy:g}")
    sensor_width_mm = max(36.0, camera.width / camera.fx)
    pixel_aspect_x = max(1.0, camera.fy / camera.fx)
    pixel_aspect_y = max(1.0, camera.fx / camera.fy)
    lens = camera.fx * sensor_width_mm / camera.width
    shift_x = -(camera.cx - (camera.width - 1) / 2) / camera.width
    shift_y = (camera.cy - (camera.height - 1) / 2) / camera.width
    shift_y = shift_y * (pixel_aspect_y / pixel_aspect_x)
    return BlenderCamera(
        camera.width,
        camera.height,
        pixel_aspect_x,
        pixel_aspect_y,
        lens=lens,
        sensor_width=sensor_width_mm,
        shift_x=shift_x,
        shift_y=shift_y,
    )
