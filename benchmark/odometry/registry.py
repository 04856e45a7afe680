"""Odometers by name and preset. To add one, write a class with PRESETS and add a line here."""

from importlib import import_module

from iclnuim.errors import InputError, WorkError

from .protocol import Odometer

#: name -> module, class; this module imports neither numba nor OpenCV
ODOMETERS = {
    "fovis": (".fovis", "Fovis"),
    "rgbd": (".photometric", "Rgbd"),
    "dvo": (".photometric", "Dvo"),
    "icp": (".icp", "Icp"),
    "icp_rgbd": (".icp", "IcpRgbd"),
}
#: third-party odometers: name -> (class in baselines.py, name of the method in the package, import
#: name of the package)
BASELINES = {
    "baseline:opencv-rgbd": ("OpencvOdometer", "RgbdOdometry", "cv2.rgbd"),
    "baseline:opencv-icp": ("OpencvOdometer", "ICPOdometry", "cv2.rgbd"),
    "baseline:opencv-rgbd-icp": ("OpencvOdometer", "RgbdICPOdometry", "cv2.rgbd"),
    "baseline:open3d-plane": ("Open3dOdometer", "PointToPlane", "open3d"),
    "baseline:open3d-intensity": ("Open3dOdometer", "Intensity", "open3d"),
    "baseline:open3d-hybrid": ("Open3dOdometer", "Hybrid", "open3d"),
}
NAMES = (*ODOMETERS, *BASELINES)
#: import name -> package for pip
PACKAGES = {
    "numba": "numba",
    "cv2": "opencv-contrib-python-headless",
    "cv2.rgbd": "'opencv-contrib-python-headless==4.11.*'",
    "open3d": "open3d-cpu",
}


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
        raise InputError(f"an odometer ({', '.join(NAMES)})", found=name)
    module, kind = ODOMETERS[name]
    try:
        found = getattr(import_module(module, __package__), kind)
    except ModuleNotFoundError as error:
        raise WorkError(
            f"{name} needs {error.name}; try: pip install {PACKAGES[error.name or '']}"
        ) from None
    if preset not in found.PRESETS:
        raise InputError(f"a preset of {name} ({', '.join(found.PRESETS)})", found=preset)
    return found(found.PRESETS[preset])
