"""Whether two folders hold the same frames: to the byte on one kind of processor and one Blender, by tolerance across kinds."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError
from iclnuim.formats.exr import read_exr
from iclnuim.formats.files import read_json
from iclnuim.formats.png import read_depth16, read_rgb8

#: By tolerance a pixel is equal within so much, and a frame where at most this share of its pixels is not: edges move by a rounding.
COLOUR_OF_255, DEPTH_M, SHARE = 3.0, 0.001, 0.01


@dataclass(frozen=True)
class Sameness:
    """`different`: files that both have; `largest_share`: of pixels beyond tolerance, in the worst file (0 where bytes were compared)."""

    files: int
    by_bytes: bool
    why: str
    different: tuple[str, ...]
    only_in_one: tuple[str, ...]
    largest_share: float

    @property
    def same(self) -> bool:
        return not self.different and not self.only_in_one


def compare(a: Path, b: Path, by_tolerance: bool = False) -> Sameness:
    """Frames of two runs (EXR) or two sequences (PNG). Raises InputError where a folder is neither, or they are not of one kind."""
    recipes = [_run_recipe(folder) for folder in (a, b)]
    theirs, ours = ({str(p.relative_to(f)): p for p in _images(f)} for f in (a, b))
    both = sorted(theirs.keys() & ours.keys())
    if not both:
        raise InputError("frames of the same numbers in both folders", path=b, found=f"none that {a} has too")
    differ = _differences(*recipes)
    why = "asked for" if by_tolerance else differ
    with ThreadPoolExecutor() as pool:
        judge = _beyond if why else _other_bytes
        shares = list(pool.map(lambda name: judge(theirs[name], ours[name]), both))
    limit = SHARE if why else 0.0
    different = tuple(name for name, share in zip(both, shares, strict=True) if share > limit)
    alone = tuple(sorted(theirs.keys() ^ ours.keys()))
    return Sameness(
        len(both), not why, why or "one kind of processor, one Blender", different, alone, max(shares) if why else 0.0
    )


def _differences(a: dict, b: dict) -> str:
    """In which of the things that bytes depend on two runs differ; nothing where they do not."""
    parts = {
        "Blender": [r.get("blender", "unknown") for r in (a, b)],
        "processor features": [" ".join(r.get("machine", {}).get("features", ["unknown"])) for r in (a, b)],
    }
    return "; ".join(f"{name}: {one} and {other}" for name, (one, other) in parts.items() if one != other)


def _run_recipe(folder: Path) -> dict:
    """Of the render run that a folder is, or that its images come from."""
    if (folder / "sequence.json").is_file():
        return read_json(folder / "sequence.json")
    if (folder / "recipe.json").is_file():
        return read_json(folder / "recipe.json").get("source", {}).get("run", {})
    raise InputError("a run (sequence.json) or a sequence (recipe.json)", path=folder, found="neither")


def _images(folder: Path) -> Iterator[Path]:
    yield from (p for p in folder.glob("*/*") if p.suffix in (".exr", ".png") and not p.name.startswith("."))


def _other_bytes(a: Path, b: Path) -> float:
    return float(a.read_bytes() != b.read_bytes())


def _beyond(a: Path, b: Path) -> float:
    """Share of pixels that differ by more than the tolerance; all of them where the sizes differ."""
    shares = []
    for one, other, tolerance in zip(_arrays(a), _arrays(b), _tolerances(a), strict=True):
        if one.shape != other.shape:
            return 1.0
        shares.append(float((np.abs(one - other) > tolerance).mean()))
    return max(shares)


def _arrays(file: Path) -> list[np.ndarray]:
    """Colour 0..255 as far as a display shows it, depth in metres."""
    if file.suffix == ".exr":
        channels = read_exr(file)
        light = np.stack([channels[c].astype(np.float32) for c in "RGB"], -1)
        return [255 * np.clip(light, 0, 1) ** (1 / 2.2), channels["Z"].astype(np.float64)]
    if file.parent.name == "depth":
        return [read_depth16(file) / 5000.0]
    return [read_rgb8(file).astype(np.float32)]


def _tolerances(file: Path) -> list[float]:
    if file.suffix == ".exr":
        return [COLOUR_OF_255, DEPTH_M]
    return [DEPTH_M if file.parent.name == "depth" else COLOUR_OF_255]
