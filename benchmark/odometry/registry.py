"""Odometers by name and preset. To add one, write a class with PRESETS and add a line here."""

from dataclasses import dataclass
from importlib import import_module
from typing import Literal

from iclnuim.errors import DISTRIBUTIONS, InputError, WorkError

from .protocol import Odometer


@dataclass(frozen=True)
class OdometerEntry:
    """An odometer of ours: its class by module and name, and what the benchmark needs of it.

    family: what it aligns. references: what the benchmark aligns its
    frames against; the first is the paper's. in_paper: whether it is one of the five odometers of
    the paper.
    """

    module: str
    class_name: str
    family: Literal["photometric", "geometric", "features"]
    references: tuple[str, ...] = ("default",)
    in_paper: bool = False


_MODEL_FIRST = ("model", "default")
#: In the order of the paper's tables; this module imports neither numba nor OpenCV.
ODOMETERS = {
    "dvo": OdometerEntry(".photometric", "Dvo", "photometric", ("default", "model"), True),
    "fovis": OdometerEntry(".fovis", "Fovis", "features", in_paper=True),
    "rgbd": OdometerEntry(".photometric", "Rgbd", "photometric", in_paper=True),
    "icp": OdometerEntry(".icp", "Icp", "geometric", _MODEL_FIRST, True),
    "icp_rgbd": OdometerEntry(".icp_rgbd", "IcpRgbd", "geometric", _MODEL_FIRST, True),
}
#: third-party odometers: name -> (class in baselines.py, name of the method in the package, import
#: name of the package)
BASELINES = {
    "opencv-rgbd": ("OpencvOdometer", "RgbdOdometry", "cv2.rgbd"),
    "opencv-icp": ("OpencvOdometer", "ICPOdometry", "cv2.rgbd"),
    "opencv-rgbd-icp": ("OpencvOdometer", "RgbdICPOdometry", "cv2.rgbd"),
    "open3d-plane": ("Open3dOdometer", "PointToPlane", "open3d"),
    "open3d-intensity": ("Open3dOdometer", "Intensity", "open3d"),
    "open3d-hybrid": ("Open3dOdometer", "Hybrid", "open3d"),
}
#: import name -> package for pip
PACKAGES = DISTRIBUTIONS | {
    "numba": "numba",
    "cv2.rgbd": "'opencv-contrib-python-headless==4.11.*'",
}


def names() -> list[str]:
    """The names of all odometers, ours first."""
    return [*ODOMETERS, *BASELINES]


def odometer(name: str, preset: str = "best") -> Odometer:
    """A new odometer.

    Raises InputError for an unknown name or preset, WorkError if a package is missing.
    """
    if name in BASELINES:
        kind, method, package = BASELINES[name]
        try:
            return getattr(import_module(".baselines", __package__), kind)(name, method)
        except (ImportError, AttributeError):
            raise WorkError(
                f"{name} needs {package}; try: pip install {PACKAGES[package]}"
            ) from None
    if name not in ODOMETERS:
        raise InputError(f"an odometer ({', '.join(names())})", found=name)
    entry = ODOMETERS[name]
    try:
        found = getattr(import_module(entry.module, __package__), entry.class_name)
    except ModuleNotFoundError as error:
        package = error.name or ""
        distribution = PACKAGES.get(package, package)
        raise WorkError(f"{name} needs {package}; try: pip install {distribution}") from None
    if preset not in found.PRESETS:
        raise InputError(f"a preset of {name} ({', '.join(found.PRESETS)})", found=preset)
    return found(found.PRESETS[preset])
