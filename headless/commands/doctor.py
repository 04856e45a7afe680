"""`iclnuim doctor`: what is installed, what is missing, what works without it, and the command that installs it."""

import argparse
import importlib.metadata
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass

from iclnuim import __version__, shipped
from iclnuim.errors import InputError, how_to_get_bpy

from ..console import Console
from ..farm.chunks import own_cores
from ..options import common


@dataclass(frozen=True)
class Finding:
    """One thing looked for: what was found, whether it will do, whether the main commands need it, and what installs it."""

    name: str
    found: str
    good: bool
    needed: bool
    mend: str = ""


#: distribution, module, needed, what for, how to install
PACKAGES = (
    ("numpy", "numpy", True, "everything", "numpy"),
    ("OpenEXR", "OpenEXR", True, "frames; inside Blender its own OpenImageIO serves", "OpenEXR"),
    ("scipy", "scipy", False, "surfaces and odometers", "scipy"),
    ("numba", "numba", False, "odometry, fusion and surface error", "numba"),
    ("opencv-contrib-python-headless", "cv2", False, "odometry and fast PNG", "opencv-contrib-python-headless==4.11.*"),
    ("open3d-cpu", "open3d", False, "check-depth, surfaces and Open3D's odometers", "open3d-cpu"),
    ("matplotlib", "matplotlib", False, "plots", "matplotlib"),
    ("submitit", "submitit", False, "Slurm", "iclnuim[slurm]"),
    ("rosbags", "rosbags", False, "ROS bags", "iclnuim[ros]"),
)


def configure(parser: argparse.ArgumentParser) -> None:
    common(parser, "iclnuim doctor")


def run(args: argparse.Namespace, console: Console) -> int:
    findings = examine()
    broken = [f for f in findings if f.needed and not f.good]
    lines = [*map(_line, findings), "", _conclusion({f.name: f.good for f in findings}, broken)]
    console.result({"findings": [asdict(f) for f in findings], "works": not broken}, "\n".join(lines))
    return 3 if broken else 0


def examine() -> list[Finding]:
    """Look at this machine; nothing is changed."""
    bpy, binary = _bpy(), _blender_binary()
    either = bpy.good or binary.good
    return [
        Finding("iclnuim", __version__, True, True),
        _python(),
        Finding("bpy", bpy.found, bpy.good, not either, bpy.mend),
        Finding("blender binary", binary.found, binary.good, not either, binary.mend),
        _denoiser(bpy.good),
        *(_package(*package) for package in PACKAGES),
        _third_party_odometers(),
        _scenes(),
        _slurm(),
        Finding("cores", str(len(own_cores())), True, False),
    ]


def _conclusion(good: dict[str, bool], broken: list[Finding]) -> str:
    if not good["bpy"] and not good["blender binary"]:
        return (
            "Without Blender: evaluation, noise, odometry and fusion work; rendering needs bpy or an installed Blender."
        )
    if broken:
        return f"Missing: {', '.join(f.name for f in broken)}."
    if not good["bpy"]:
        return "Rendering runs in the installed Blender; bake, surface, check-depth and trajectories through a scene need bpy."
    return "Everything that is needed is installed."


def _line(finding: Finding) -> str:
    mark = "ok      " if finding.good else "MISSING " if finding.needed else "optional"
    mend = f"   -> {finding.mend}" if finding.mend and not finding.good else ""
    return f"{mark}  {finding.name:<32}{finding.found}{mend}"


def _python() -> Finding:
    version = sys.version_info[:2]
    good = version in ((3, 11), (3, 13))
    found = platform.python_version() + ("" if good else ", for which there is no bpy")
    return Finding("Python", found, good, False, "Python 3.11 (bpy 4.5 LTS) or 3.13 (bpy 5.2 LTS)")


def _bpy() -> Finding:
    """By importing it in a process of its own: where system libraries are missing it fails, and says which."""
    mend = how_to_get_bpy()
    if importlib.util.find_spec("bpy") is None:
        return Finding("bpy", "not installed", False, False, mend)
    done = _python_says("import bpy; print('version', bpy.app.version_string)")
    version = re.search(r"^version (.*)$", done.stdout, re.M)
    if version:
        return Finding("bpy", version[1], True, False)
    library = re.search(r"(lib\S+\.so\S*): cannot open", done.stderr)
    last = (done.stderr.strip().splitlines() or ["does not start"])[-1]
    words = f"needs the system library {library[1]}" if library else last
    return Finding("bpy", words, False, False, "./setup.sh installs the system libraries that it needs")


def _blender_binary() -> Finding:
    path = shutil.which("blender")
    mend = "https://www.blender.org/download (4.5 LTS or 5.2 LTS)"
    if path is None:
        return Finding("blender binary", "not on the PATH", False, False, mend)
    done = _asked(path, "--version")
    version = re.search(r"Blender (\d+)\.(\d+)\S*", done.stdout)
    good = version is not None and (int(version[1]), int(version[2])) >= (4, 2)
    return Finding("blender binary", f"{version[0] if version else 'no version'} at {path}", good, False, mend)


def _denoiser(has_bpy: bool) -> Finding:
    if not has_bpy:
        return Finding("denoiser", "unknown without bpy", False, False)
    done = _python_says("import bpy, _cycles; print('denoiser', _cycles.with_openimagedenoise)")
    good, mend = "denoiser True" in done.stdout, "install the bpy package or a Blender from blender.org"
    return Finding("denoiser", "OpenImageDenoise" if good else "none", good, False, mend)


def _package(name: str, module: str, needed: bool, what: str, install: str) -> Finding:
    if importlib.util.find_spec(module) is None:
        return Finding(name, f"not installed; for {what}", False, needed, f"pip install '{install}'")
    names = importlib.metadata.packages_distributions().get(module, [name])
    other = "" if name in names else f" of {names[0]}"
    return Finding(name, importlib.metadata.version(name if name in names else names[0]) + other, True, needed)


def _third_party_odometers() -> Finding:
    """OpenCV's lie in a contrib module that other OpenCV packages, and OpenCV 5, do not have."""
    done = _python_says("import cv2; print('rgbd', hasattr(cv2, 'rgbd'))")
    good, install = "rgbd True" in done.stdout, "pip install 'opencv-contrib-python-headless==4.11.*'"
    return Finding("OpenCV's odometers", "cv2.rgbd" if good else "this OpenCV has no cv2.rgbd", good, False, install)


def _scenes() -> Finding:
    try:
        count = len(shipped.sequence_names())
        return Finding("shipped sequences", str(count), count > 0, False, "install iclnuim again")
    except InputError as error:
        return Finding("shipped sequences", str(error), False, False, "install iclnuim again")


def _slurm() -> Finding:
    path, mend = shutil.which("sbatch"), "run on a login node of your cluster; other engines do not need it"
    return Finding("Slurm", path or "no sbatch on the PATH", path is not None, False, mend)


def _python_says(program: str) -> subprocess.CompletedProcess:
    return _asked(sys.executable, "-c", program)


def _asked(*command: str) -> subprocess.CompletedProcess:
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
