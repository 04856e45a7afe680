"""The recipe of a run: its job, and what else decides the bytes of its frames."""

import platform
import sys
from pathlib import Path

import numpy as np

from ... import shipped
from ...formats.files import read_bytes, sha256
from ...job import RenderJob
from ...sequences.run_folder import RunFolder, trajectory_file
from ...version import __version__
from .. import compat
from ..light import mipmaps
from ..open import scene


def recipe(job: RenderJob) -> dict:
    """The content of sequence.json."""
    processor = _cpuinfo("model name") or platform.processor()
    return {
        "schema_version": 1,
        "job": job.to_dict(),
        "trajectory_sha256": sha256(read_bytes(trajectory_file(job))),
        "scene_sha256": scene.scene_sha256(job.scene),
        "blender": compat.version_line(),
        "texture_filter": mipmaps.VERSION,
        "versions": {
            "iclnuim": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "source_commit": shipped.source_commit(),
        "machine": {"system": platform.platform(), "processor": processor, "features": _features()},
    }


def processor_note(run: RunFolder) -> str | None:
    """A sentence if the run was started on a processor whose frames may have other bytes."""
    begun = run.recipe.get("machine", {}).get("features")
    features = _features()
    if begun is None or begun == features:
        return None
    processors = f"a processor with {' '.join(begun)}, this one has {' '.join(features)}"
    expected = "frames of both are equal within a tolerance, not byte by byte"
    return f"this run was started on {processors}: {expected}"


def _features() -> list[str]:
    """Processor features that select Cycles' kernels: frames are guaranteed to have equal bytes
    only on processors with equal features.
    """
    return sorted(
        set(_cpuinfo("flags").split()) & {"sse4_2", "avx", "avx2", "fma", "f16c", "avx512f"}
    )


def _cpuinfo(key: str) -> str:
    """An entry of /proc/cpuinfo for the first processor; empty if there is none (not Linux, another
    architecture).
    """
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith(key):
                return line.split(":", 1)[1].strip()
    return ""
