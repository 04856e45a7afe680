"""`iclnuim doctor`: what is installed, what is missing, and the command that mends it."""

from __future__ import annotations

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
from iclnuim.errors import InputError

from ..console import Console
from ..farm.cores import own_cores
from ..options import common


@dataclass(frozen=True)
class Finding:
    """One thing looked for: what was found, whether it will do, whether anything works without it, and what mends it."""

    name: str
    found: str
    good: bool
    needed: bool
    mend: str = ""


def configure(parser: argparse.ArgumentParser) -> None:
    common(parser, "iclnuim doctor")


def run(args: argparse.Namespace, console: Console) -> int:
    findings = examine()
    broken = [f for f in findings if f.needed and not f.good]
    console.result({"findings": [asdict(f) for f in findings], "works": not broken}, "\n".join(map(_line, findings)))
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
        *(_package(name, module, needed, what) for name, module, needed, what in PACKAGES),
        _scenes(),
        _slurm(),
        Finding(
            "cores",
            str(len(own_cores())),
            True,
            False,
        ),
    ]


PACKAGES = (
    ("numpy", "numpy", True, "everything"),
    ("OpenEXR", "OpenEXR", True, "frames; inside Blender its own OpenImageIO serves"),
    ("opencv-python-headless", "cv2", False, "fast PNG"),
    ("matplotlib", "matplotlib", False, "plots"),
    ("scipy", "scipy", False, "surfaces and odometers"),
    ("open3d-cpu", "open3d", False, "check-depth"),
    ("submitit", "submitit", False, "--engine slurm"),
)


def _line(finding: Finding) -> str:
    mark = "ok     " if finding.good else "MISSING" if finding.needed else "absent "
    mend = f"   -> {finding.mend}" if finding.mend and not finding.good else ""
    return f"{mark}  {finding.name:<24}{finding.found}{mend}"


def _python() -> Finding:
    version = sys.version_info[:2]
    good = version in ((3, 11), (3, 13))
    return Finding("Python", platform.python_version(), good, False, "Python 3.11 (bpy 4.5 LTS) or 3.13 (bpy 5.2 LTS)")


def _bpy() -> Finding:
    """By importing it in a process of its own: where system libraries are missing it fails, and says which."""
    mend = "pip install bpy"
    if importlib.util.find_spec("bpy") is None:
        return Finding("bpy", "not installed", False, False, mend)
    program = "import bpy; print('version', bpy.app.version_string)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    version = re.search(r"^version (.*)$", done.stdout, re.M)
    if version:
        return Finding("bpy", version[1], True, False)
    library = re.search(r"(lib\S+\.so\S*): cannot open", done.stderr)
    words = (
        f"needs the system library {library[1]}"
        if library
        else (done.stderr.strip().splitlines() or ["does not start"])[-1]
    )
    return Finding("bpy", words, False, False, "./setup.sh installs the system libraries that it needs")


def _blender_binary() -> Finding:
    path = shutil.which("blender")
    mend = "https://www.blender.org/download (4.5 LTS or 5.2 LTS)"
    if path is None:
        return Finding("blender binary", "not on the PATH", False, False, mend)
    done = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=120, check=False)
    version = re.search(r"Blender (\d+)\.(\d+)\S*", done.stdout)
    good = bool(version) and (int(version[1]), int(version[2])) >= (4, 2)
    return Finding("blender binary", f"{version[0] if version else 'no version'} at {path}", good, False, mend)


def _denoiser(has_bpy: bool) -> Finding:
    if not has_bpy:
        return Finding("denoiser", "unknown without bpy", False, False)
    program = "import bpy, _cycles; print('denoiser', _cycles.with_openimagedenoise)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    good = "denoiser True" in done.stdout
    return Finding(
        "denoiser", "OpenImageDenoise" if good else "none", good, False, "a Blender from blender.org or the bpy package"
    )


def _package(name: str, module: str, needed: bool, what: str) -> Finding:
    if importlib.util.find_spec(module) is None:
        return Finding(name, f"not installed (for {what})", False, needed, f"pip install {name}")
    try:
        version = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        version = "there"
    return Finding(name, version, True, needed)


def _scenes() -> Finding:
    try:
        count = len(shipped.sequence_names())
        return Finding("shipped sequences", str(count), count > 0, False, "installing iclnuim again")
    except InputError as error:
        return Finding("shipped sequences", str(error), False, False, "installing iclnuim again")


def _slurm() -> Finding:
    path = shutil.which("sbatch")
    return Finding(
        "Slurm",
        path or "no sbatch on the PATH",
        path is not None,
        False,
        "a login node of your cluster; the local farm needs none",
    )
