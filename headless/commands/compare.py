"""`iclnuim compare A B`: compares frames byte for byte, or within a tolerance if processors or
Blender versions differ.
"""

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from iclnuim.console import Console
from iclnuim.dataset.frames import read_camera
from iclnuim.dataset.ground_truth import KINDS, NORMAL, NORMAL_STEPS, NORMAL_ZERO
from iclnuim.errors import InputError, within
from iclnuim.formats.exr import read_exr
from iclnuim.formats.files import read_json
from iclnuim.formats.png import read_depth16, read_rgb8, read_rgb16

from ..options import common

#: Tolerances of a pixel (colour of 0..255, depth in metres), and the largest share of pixels of a
#: frame beyond them: rounding moves edges.
COLOUR_OF_255, DEPTH_M, SHARE = 3.0, 0.001, 0.01
#: Channel -> tolerance; that of normals is per component of a unit normal. Labels of instances and
#: classes have no tolerance.
_TOLERANCES = {
    **dict.fromkeys(("RGB", "rgb"), COLOUR_OF_255),
    **dict.fromkeys(("Z", "depth"), DEPTH_M),
    "normal": 0.01,
}


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
        tolerance = (
            f"{COLOUR_OF_255:g} of 255, {1000 * DEPTH_M:g} mm, {100 * SHARE:g} % of the pixels"
        )
        worst = f"worst file {100 * found['largest_share']:.2g} %"
        how = f"{found['files']} files compared within a tolerance ({found['why']}): {tolerance}; {worst}"
    names = [
        f"{name} ({', '.join(channels) or 'no channel'})"
        for name, channels in found["channels"].items()
    ]
    names += [f"{name} (in one folder only)" for name in found["only_in_one"]]
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    counts = f"{len(found['different'])} differ, {len(found['only_in_one'])} are in one folder only"
    text = f"{how}: equal" if found["same"] else f"{how}: {counts}: {', '.join(names[:10])}{more}"
    console.result(found, text)
    return 0 if found["same"] else 3


def compare(a: Path, b: Path, by_tolerance: bool) -> dict:
    """Compare the frames of two runs (EXR) or two sequences (PNG). Raises InputError if a folder is
    neither, or if their kinds differ.

    Keys: `different`: names of files that are in both folders and differ; `channels`: file ->
    channels that differ (none if only the header differs); `largest_share`: share of pixels beyond
    the tolerance in the worst file (0 if bytes were compared).
    """
    origins = _origin(a), _origin(b)
    images = (
        [p for p in d.glob("*/*") if p.suffix in (".exr", ".png") and p.name[0] != "."]
        for d in (a, b)
    )
    files = [
        {str(p.relative_to(d)): p for p in found} for d, found in zip((a, b), images, strict=True)
    ]
    both = sorted(files[0].keys() & files[1].keys())
    if not both:
        raise InputError(
            "frames with the same numbers in both folders", path=b, found=f"none that {a} has too"
        )
    parts = zip(
        ("Blender", "processor features"), *origins, strict=True
    )  # the bytes depend on these
    differences = [f"{name}: {one} and {other}" for name, one, other in parts if one != other]
    why = "requested" if by_tolerance else "; ".join(differences)
    pngs = [
        next((file for file in found.values() if file.suffix == ".png"), None) for found in files
    ]
    units = [
        read_camera(d, png).depth_units_per_metre if png else 1.0
        for d, png in zip((a, b), pngs, strict=True)
    ]

    def compare_file(name: str) -> tuple[bool, float, list[str]]:
        one, other = files[0][name], files[1][name]
        if not why:
            if one.read_bytes() == other.read_bytes():
                return False, 0.0, []
            other_channels = _other_channels(one, other)
            same_png = (
                one.suffix == ".png" and other_channels == []
            )  # versions before 0.2.0 compressed in another way
            return not same_png, 0.0, other_channels or []
        shares = _shares(_channels(one, units[0]), _channels(other, units[1]))
        beyond = [channel for channel, share in shares.items() if share > SHARE]
        return bool(beyond), max(shares.values()), beyond

    with ThreadPoolExecutor() as pool:
        compared = dict(zip(both, pool.map(compare_file, both), strict=True))
    channels = {name: names for name, (differs, _, names) in compared.items() if differs}
    alone = sorted(files[0].keys() ^ files[1].keys())
    return {
        "files": len(both),
        "by_bytes": not why,
        "why": why or "same kind of processor, same Blender",
        "different": list(channels),
        "only_in_one": alone,
        "largest_share": max(share for _, share, _ in compared.values()) if why else 0.0,
        "channels": channels,
        "same": not channels and not alone,
    }


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
        one, other = (read_exr(f) if f.suffix == ".exr" else _channels(f, 1.0) for f in (a, b))
    except InputError:
        return None
    equal = {
        name
        for name in one.keys() & other.keys()
        if np.array_equal(one[name], other[name], equal_nan=True)
    }
    return [name for name in one | other if name not in equal]


def _shares(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, float]:
    """Channel -> share of pixels that differ by more than its tolerance; 1 if one file lacks the
    channel, or the sizes differ.
    """
    shares = {}
    for name in a | b:
        same_size = name in a and name in b and a[name].shape == b[name].shape
        shares[name] = (
            float((np.abs(a[name] - b[name]) > _TOLERANCES.get(name, 0.0)).mean())
            if same_size
            else 1.0
        )
    return shares


def _channels(file: Path, units_per_metre: float) -> dict[str, np.ndarray]:
    """Channels of an image file: colour 0..255 clipped to a display's range, depth in metres,
    normals -1..1, labels.
    """
    if file.suffix == ".exr":
        channels = read_exr(file)
        linear = np.stack([channels.pop(c).astype(np.float32) for c in "RGB"], -1)
        normal = [channels.pop(c) for c in NORMAL if c in channels]
        more = {"normal": np.stack(normal, -1)} if normal else {}
        colour = {"RGB": 255 * np.clip(linear, 0, 1) ** (1 / 2.2)}
        return colour | {c: v.astype(float) for c, v in channels.items()} | more
    kind = file.parent.name
    if kind == "depth":
        return {kind: read_depth16(file) / units_per_metre}
    if kind == "normal":
        return {kind: (read_rgb16(file) - float(NORMAL_ZERO)) / NORMAL_STEPS}
    if kind in KINDS:
        return {kind: read_depth16(file).astype(float)}
    return {"rgb": read_rgb8(file).astype(np.float32)}
