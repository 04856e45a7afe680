"""`iclnuim doctor`: reports what is installed, what is missing, what works without it, and the
command that installs it.
"""

import importlib.metadata
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, dataclass, replace

from iclnuim import shipped, wall
from iclnuim.console import Console
from iclnuim.errors import InputError, how_to_get_bpy
from iclnuim.version import __version__

from ..farm.chunks import own_cores
from ..options import common


@dataclass(frozen=True)
class Finding:
    """Result of one check. found: what was found. ok: whether it is sufficient. fix: how to
    install it. required: whether the main commands need it.
    """

    name: str
    found: str
    ok: bool
    fix: str = ""
    required: bool = False


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
    ("PyYAML", "yaml", False, "cameras of the formats euroc and vslam-lab", "PyYAML"),
    ("submitit", "submitit", False, "Slurm", "submitit"),
    ("rosbags", "rosbags", False, "ROS bags", "rosbags"),
    ("rerun-sdk", "rerun", False, "recordings for the viewer Rerun", "rerun-sdk"),
)


def configure(parser: ArgumentParser) -> None:
    common(parser, "iclnuim doctor")


def run(args: Namespace, console: Console) -> int:
    findings = examine()
    broken = [f for f in findings if f.required and not f.ok]
    lines = []
    for f in findings:
        mark = "MISSING " if f.required else "optional"
        line = f"{f.name:<32}{f.found}"
        if f.ok:
            mark = "ok      "
        elif f.fix:
            line += f"   -> {f.fix}"
        lines.append(f"{mark}  {line}")
    lines += ["", _conclusion({f.name: f.ok for f in findings}, broken)]
    values = {"checks": [asdict(f) for f in findings], "ok": not broken}
    console.result(values, "\n".join(lines))
    return 3 if broken else 0


def examine() -> list[Finding]:
    """Check this machine; nothing is changed."""
    bpy = _bpy()
    binary = _blender_binary()
    neither = not bpy.ok and not binary.ok
    return [
        Finding("iclnuim", __version__, True, required=True),
        _python(),
        replace(bpy, required=neither),
        replace(binary, required=neither),
        _denoiser(bpy.ok),
        _compressed_files(),
        *(_package(*package) for package in PACKAGES),
        _opencv_odometers(),
        _sequences(),
        _slurm(),
        _wall(),
        Finding("cores", str(len(own_cores())), True),
    ]


def _python() -> Finding:
    found = platform.python_version()
    has_bpy = sys.version_info[:2] in ((3, 11), (3, 13))
    if not has_bpy:
        found += ", for which there is no bpy"
    return Finding("Python", found, has_bpy, "Python 3.11 (bpy 4.5 LTS) or 3.13 (bpy 5.2 LTS)")


def _denoiser(has_bpy: bool) -> Finding:
    if not has_bpy:
        return Finding("denoiser", "unknown without bpy", False)
    program = "import bpy, _cycles; print('denoiser', _cycles.with_openimagedenoise)"
    if "denoiser True" in _output_of(sys.executable, "-c", program).stdout:
        return Finding("denoiser", "OpenImageDenoise", True)
    fix = "install the bpy package or a Blender from blender.org"
    return Finding("denoiser", "none", False, fix)


def _compressed_files() -> Finding:
    """What this Python needs to look into a compressed .blend; in Blender it is there."""
    good = importlib.util.find_spec("zstandard") is not None
    found = "zstandard" if good else "no zstandard: only Blender itself reads them"
    return Finding("compressed .blend files", found, good, "pip install zstandard")


def _opencv_odometers() -> Finding:
    """They are in a contrib module, which other OpenCV packages and OpenCV 5 do not have."""
    program = "import cv2; print('rgbd', hasattr(cv2, 'rgbd'))"
    good = "rgbd True" in _output_of(sys.executable, "-c", program).stdout
    found = "cv2.rgbd" if good else "this OpenCV has no cv2.rgbd"
    fix = "pip install 'opencv-contrib-python-headless==4.11.*'"
    return Finding("OpenCV's odometers", found, good, fix)


def _sequences() -> Finding:
    fix = "reinstall iclnuim"
    try:
        names = shipped.sequence_names()
    except InputError as error:
        return Finding("shipped sequences", str(error), False, fix)
    more = [name for name in names if name not in shipped.paper_sequences()]
    found = f"{len(names)}: those of the paper, and {', '.join(more)}"
    return Finding("shipped sequences", found, len(names) > 0, fix)


def _slurm() -> Finding:
    sbatch = shutil.which("sbatch")
    fix = "run this on a login node of your cluster; other engines do not need it"
    return Finding("Slurm", sbatch or "no sbatch on the PATH", bool(sbatch), fix)


def _wall() -> Finding:
    """What keeps a user's scene from reading files outside its folder."""
    name = "wall around scenes"
    if version := wall.version():
        outside = ", ".join(wall.refused(version))
        return Finding(name, f"Landlock {version}: refuses {outside} outside", True)
    found = "names in the scene's files are checked, without a wall of the kernel"
    return Finding(name, found, False, "Linux 5.13 or later with Landlock")


def _conclusion(good: dict[str, bool], broken: list[Finding]) -> str:
    if not good["bpy"] and not good["blender binary"]:
        works = "evaluation, noise, odometry and fusion work"
        return f"Without Blender: {works}; rendering needs bpy or an installed Blender."
    if broken:
        return f"Missing: {', '.join(f.name for f in broken)}."
    if not good["bpy"]:
        need = "bake, surface, check-depth and trajectories through a scene need bpy"
        return f"Rendering uses the installed Blender; {need}."
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
    if version is None:
        return Finding("blender binary", f"no version at {path}", False, fix)
    good = (int(version[1]), int(version[2])) >= (4, 2)
    return Finding("blender binary", f"{version[0]} at {path}", good, fix)


def _package(name: str, module: str, needed: bool, what: str, install: str) -> Finding:
    if importlib.util.find_spec(module) is None:
        fix = f"pip install '{install}'"
        return Finding(name, f"not installed; for {what}", False, fix, needed)
    names = importlib.metadata.packages_distributions().get(module, [name])
    if name in names:
        found = importlib.metadata.version(name)
    else:
        found = f"{importlib.metadata.version(names[0])} of {names[0]}"
    return Finding(name, found, True, required=needed)


def _output_of(*command: str) -> subprocess.CompletedProcess:
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
