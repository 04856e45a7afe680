"""`iclnuim compare A B`: compares frames byte for byte, or within a tolerance if processors or
Blender versions differ.
"""

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from iclnuim.channels import CHANNELS, DEPTH, RGB
from iclnuim.console import Console
from iclnuim.dataset.frames import read_camera
from iclnuim.errors import InputError, within
from iclnuim.formats.exr import read_exr
from iclnuim.formats.files import read_json
from iclnuim.formats.png import read_png

from ..options import common

#: The largest share of pixels of a frame beyond a channel's tolerance: rounding moves edges.
SHARE = 0.01


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="a run (EXR frames) or a sequence")
    parser.add_argument(
        "b", type=Path, metavar="B", help="another run or sequence, of the same kind as A"
    )
    help = "compare within the tolerance even if equal bytes can be expected"
    parser.add_argument("--tolerance", action="store_true", help=help)
    common(parser, "iclnuim compare out/living_room/kt2/clean elsewhere/kt2/clean")


def run(args: argparse.Namespace, console: Console) -> int:
    found = compare(args.a, args.b, args.tolerance)
    if found["by_bytes"]:
        how = f"{found['files']} files compared byte for byte ({found['why']})"
    else:
        colour = CHANNELS[RGB].tolerance
        depth_mm = 1000 * CHANNELS[DEPTH].tolerance
        how = (
            f"{found['files']} files compared within a tolerance ({found['why']}): "
            f"{colour:g} of 255, {depth_mm:g} mm, {100 * SHARE:g} % of the pixels; "
            f"worst file {100 * found['largest_share']:.2g} %"
        )
    if found["same"]:
        console.result(found, f"{how}: equal")
        return 0
    names = []
    for name, channels in found["channels"].items():
        names.append(f"{name} ({', '.join(channels) or 'no channel'})")
    names += [f"{name} (in one folder only)" for name in found["only_in_one"]]
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    counts = f"{len(found['different'])} differ, {len(found['only_in_one'])} are in one folder only"
    console.result(found, f"{how}: {counts}: {', '.join(names[:10])}{more}")
    return 3


def compare(a: Path, b: Path, by_tolerance: bool) -> dict:
    """Compare the frames of two runs (EXR) or two sequences (PNG). Raises InputError if a folder is
    neither, or if their kinds differ.

    Keys: `different`: names of files that are in both folders and differ; `channels`: file ->
    channels that differ (none if only the header differs); `largest_share`: share of pixels beyond
    the tolerance in the worst file (0 if bytes were compared).
    """
    # the bytes depend on these
    origins = zip(("Blender", "processor features"), _origin(a), _origin(b), strict=True)
    differences = [f"{name}: {x} and {y}" for name, x, y in origins if x != y]
    why = "requested" if by_tolerance else "; ".join(differences)
    one = _Images.of(a)
    other = _Images.of(b)
    both = sorted(one.files.keys() & other.files.keys())
    if not both:
        raise InputError(
            "frames with the same numbers in both folders", path=b, found=f"none that {a} has too"
        )
    with ThreadPoolExecutor() as pool:
        if why:
            results = list(pool.map(lambda name: _beyond_tolerance(one, other, name), both))
        else:
            results = list(pool.map(lambda name: _other_bytes(one, other, name), both))
    channels = {}
    for name, result in zip(both, results, strict=True):
        if result.differs:
            channels[name] = result.channels
    alone = sorted(one.files.keys() ^ other.files.keys())
    return {
        "files": len(both),
        "by_bytes": not why,
        "why": why or "same kind of processor, same Blender",
        "different": list(channels),
        "only_in_one": alone,
        "largest_share": max(result.share for result in results),
        "channels": channels,
        "same": not channels and not alone,
    }


@dataclass(frozen=True)
class _Images:
    """The images of a folder by name, and the depth units per metre of its PNGs."""

    files: dict[str, Path]
    units_per_metre: float

    @classmethod
    def of(cls, folder: Path) -> "_Images":
        images = (path for path in folder.glob("*/*") if path.suffix in (".exr", ".png"))
        files = {str(p.relative_to(folder)): p for p in images if p.name[0] != "."}
        png = next((file for file in files.values() if file.suffix == ".png"), None)
        return cls(files, read_camera(folder, png).depth_units_per_metre if png else 1.0)

    def values(self, name: str) -> dict[str, np.ndarray]:
        return _values(self.files[name], self.units_per_metre)


class _Result(NamedTuple):
    """Whether a file differs, in which channels, and the share of pixels beyond the tolerance."""

    differs: bool
    channels: list[str]
    share: float = 0.0


def _other_bytes(a: _Images, b: _Images, name: str) -> _Result:
    """The comparison of a file byte for byte. PNGs of the same pixels are equal: another library
    may have compressed them.
    """
    if a.files[name].read_bytes() == b.files[name].read_bytes():
        return _Result(False, [])
    different = _other_channels(a.files[name], b.files[name])
    same_pixels = name.endswith(".png") and different == []
    return _Result(not same_pixels, different or [])


def _beyond_tolerance(a: _Images, b: _Images, name: str) -> _Result:
    """The comparison of a file within the tolerances of its channels."""
    shares = _shares(a.values(name), b.values(name))
    beyond = [channel for channel, share in shares.items() if share > SHARE]
    return _Result(bool(beyond), beyond, max(shares.values()))


def _origin(folder: Path) -> tuple[str, str]:
    """Blender's version and the processor's features in the recipe of the run in this folder, or of
    the run from which this sequence comes.
    """
    for name, inside in (("sequence.json", ()), ("recipe.json", ("source", "run"))):
        if (folder / name).is_file():
            with within(folder / name):
                run = _object_in(read_json(folder / name), *inside)
                features = _object_in(run, "machine").get("features", ["unknown"])
                if not isinstance(features, list):
                    raise InputError("a list as features", found=json.dumps(features))
                return str(run.get("blender", "unknown")), " ".join(map(str, features))
    raise InputError(
        "a run (sequence.json) or a sequence (recipe.json)", path=folder, found="neither"
    )


def _object_in(content: dict, *keys: str) -> dict:
    """The object under nested keys; {} where a key is absent.

    Raises InputError for another value.
    """
    for key in keys:
        content = content.get(key, {})
        if not isinstance(content, dict):
            raise InputError(f"a JSON object as {key}", found=json.dumps(content))
    return content


def _other_channels(a: Path, b: Path) -> list[str] | None:
    """Names of the channels that are not bitwise equal; None if a file cannot be read."""
    try:
        one = _stored(a)
        other = _stored(b)
    except InputError:
        return None
    different = []
    for name in one | other:
        both = name in one and name in other
        if not (both and np.array_equal(one[name], other[name], equal_nan=True)):
            different.append(name)
    return different


def _stored(file: Path) -> dict[str, np.ndarray]:
    return read_exr(file) if file.suffix == ".exr" else _values(file, 1.0)


def _shares(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, float]:
    """Channel -> share of pixels that differ by more than its tolerance; 1 if one file lacks the
    channel, or the sizes differ.
    """
    tolerances = {}
    for name, channel in CHANNELS.items():
        tolerances[name] = tolerances[channel.exr_name or name] = channel.tolerance
    shares = {}
    for name in a | b:
        shares[name] = 1.0
        if name in a and name in b and a[name].shape == b[name].shape:
            beyond = np.abs(a[name] - b[name]) > tolerances.get(name, 0.0)
            shares[name] = float(beyond.mean())
    return shares


def _values(file: Path, units_per_metre: float) -> dict[str, np.ndarray]:
    """The values of an image file by channel, as channels.py describes them: colour 0..255 clipped
    to a display's range, depth in metres, normals -1..1, labels.
    """
    if file.suffix == ".png":
        name = file.parent.name if file.parent.name in CHANNELS else RGB
        return {name: CHANNELS[name].decode(read_png(file), units_per_metre)}
    exr = read_exr(file)
    found = {}
    for channel in CHANNELS.values():
        # not an image of the same channels, as classes are of instances
        if exr.keys() >= channel.exr.keys():
            image = channel.read(exr, lambda: np.zeros(0))
            found[channel.exr_name or channel.name] = channel.displayed(image)
            for name in channel.exr:
                del exr[name]
    return found | {name: values.astype(float) for name, values in exr.items()}
