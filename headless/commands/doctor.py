"""`iclnuim doctor`: reports what is installed, what is missing, what works without it, and the
command that installs it.
"""

import argparse
import importlib.metadata
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass, replace

from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, how_to_get_bpy
from iclnuim.version import __version__

from ..farm.chunks import own_cores
from ..options import common


@dataclass(frozen=True)
class Finding:
    """Result of one check. found: what was found. good: whether it is sufficient. mend: how to
    install it. needed: whether the main commands need it.
    """

    name: str
    found: str
    good: bool
    mend: str = ""
    needed: bool = False


#: distribution, module, needed, what for, how to install
PACKAGES = (
    ("numpy", "numpy", True, "everything", "numpy"),
    ("OpenEXR", "OpenEXR", True, "frames; inside Blender, its OpenImageIO is used", "OpenEXR"),
    ("scipy", "scipy", False, "surfaces and odometers", "scipy"),
    ("numba", "numba", False, "odometry, fusion and surface error", "numba"),
    (
        "opencv-contrib-python-headless",
        "cv2",
        False,
        "odometry and fast PNG",
        "opencv-contrib-python-headless==4.11.*",
    ),
    ("deflate", "deflate", False, "writing PNG in half the time", "deflate"),
    ("libigl", "igl", False, "distances to surfaces", "libigl"),
    ("embreex", "embreex", False, "check-depth, clearances, visibility of surfaces", "embreex"),
    ("open3d-cpu", "open3d", False, "Open3D's odometers; glTF meshes", "open3d-cpu"),
    ("matplotlib", "matplotlib", False, "plots", "matplotlib"),
    ("submitit", "submitit", False, "Slurm", "submitit"),
    ("rosbags", "rosbags", False, "ROS bags", "rosbags"),
    ("rerun-sdk", "rerun", False, "recordings for the viewer Rerun", "rerun-sdk"),
)


def configure(parser: argparse.ArgumentParser) -> None:
    common(parser, "iclnuim doctor")


def run(args: argparse.Namespace, console: Console) -> int:
    findings = examine()
    broken = [f for f in findings if f.needed and not f.good]
    lines = []
    for f in findings:
        mark = "ok      " if f.good else "MISSING " if f.needed else "optional"
        lines.append(
            f"{mark}  {f.name:<32}{f.found}{f'   -> {f.mend}' if f.mend and not f.good else ''}"
        )
    lines += ["", _conclusion({f.name: f.good for f in findings}, broken)]
    console.result(
        {"findings": [asdict(f) for f in findings], "works": not broken}, "\n".join(lines)
    )
    return 3 if broken else 0


def examine() -> list[Finding]:
    """Check this machine; nothing is changed."""
    bpy, binary, has_python = _bpy(), _blender_binary(), sys.version_info[:2] in ((3, 11), (3, 13))
    neither = not bpy.good and not binary.good
    python = platform.python_version() + ("" if has_python else ", for which there is no bpy")
    program = "import bpy, _cycles; print('denoiser', _cycles.with_openimagedenoise)"
    has_denoiser = bpy.good and "denoiser True" in _output_of(sys.executable, "-c", program).stdout
    denoiser = "OpenImageDenoise" if has_denoiser else "none" if bpy.good else "unknown without bpy"
    # OpenCV's odometers are in a contrib module, which other OpenCV packages and OpenCV 5 do not
    # have
    program = "import cv2; print('rgbd', hasattr(cv2, 'rgbd'))"
    has_rgbd = "rgbd True" in _output_of(sys.executable, "-c", program).stdout
    rgbd = "cv2.rgbd" if has_rgbd else "this OpenCV has no cv2.rgbd"
    try:
        names, sequences = shipped.sequence_names(), ""
    except InputError as error:
        names, sequences = [], str(error)
    sbatch, login_node = (
        shutil.which("sbatch"),
        "run this on a login node of your cluster; other engines do not need it",
    )
    return [
        Finding("iclnuim", __version__, True, needed=True),
        Finding("Python", python, has_python, "Python 3.11 (bpy 4.5 LTS) or 3.13 (bpy 5.2 LTS)"),
        replace(bpy, needed=neither),
        replace(binary, needed=neither),
        Finding(
            "denoiser",
            denoiser,
            has_denoiser,
            "install the bpy package or a Blender from blender.org" * bpy.good,
        ),
        *(_package(*package) for package in PACKAGES),
        Finding(
            "OpenCV's odometers",
            rgbd,
            has_rgbd,
            "pip install 'opencv-contrib-python-headless==4.11.*'",
        ),
        Finding(
            "shipped sequences", sequences or str(len(names)), len(names) > 0, "reinstall iclnuim"
        ),
        Finding("Slurm", sbatch or "no sbatch on the PATH", bool(sbatch), login_node),
        Finding("cores", str(len(own_cores())), True),
    ]


def _conclusion(good: dict[str, bool], broken: list[Finding]) -> str:
    if not good["bpy"] and not good["blender binary"]:
        works = "evaluation, noise, odometry and fusion work"
        return f"Without Blender: {works}; rendering needs bpy or an installed Blender."
    if broken:
        return f"Missing: {', '.join(f.name for f in broken)}."
    if not good["bpy"]:
        return "Rendering uses the installed Blender; bake, surface, check-depth and trajectories through a scene need bpy."
    return "All required components are installed."


def _bpy() -> Finding:
    """Check bpy by importing it in a separate process: without the system libraries it fails, and
    names the missing one.
    """
    fix = how_to_get_bpy()
    if importlib.util.find_spec("bpy") is None:
        return Finding("bpy", "not installed", False, fix)
    done = _output_of(sys.executable, "-c", "import bpy; print('version', bpy.app.version_string)")
    version = re.search(r"^version (.*)$", done.stdout, re.M)
    if version:
        return Finding("bpy", version[1], True)
    library = re.search(r"(lib\S+\.so\S*): cannot open", done.stderr)
    last = (done.stderr.strip().splitlines() or ["does not start"])[-1]
    problem = f"needs the system library {library[1]}" if library else last
    return Finding("bpy", problem, False, "./setup.sh installs the system libraries that it needs")


def _blender_binary() -> Finding:
    path = shutil.which("blender")
    fix = "https://www.blender.org/download (4.5 LTS or 5.2 LTS)"
    if path is None:
        return Finding("blender binary", "not on the PATH", False, fix)
    done = _output_of(path, "--version")
    version = re.search(r"Blender (\d+)\.(\d+)\S*", done.stdout)
    good = version is not None and (int(version[1]), int(version[2])) >= (4, 2)
    return Finding(
        "blender binary", f"{version[0] if version else 'no version'} at {path}", good, fix
    )


def _package(name: str, module: str, needed: bool, what: str, install: str) -> Finding:
    if importlib.util.find_spec(module) is None:
        return Finding(
            name, f"not installed; for {what}", False, f"pip install '{install}'", needed
        )
    names = importlib.metadata.packages_distributions().get(module, [name])
    other = "" if name in names else f" of {names[0]}"
    return Finding(
        name,
        importlib.metadata.version(name if name in names else names[0]) + other,
        True,
        needed=needed,
    )


def _output_of(*command: str) -> subprocess.CompletedProcess:
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
