"""`iclnuim compare A B`: compares every file of two folders byte for byte, or, if processors or
Blender versions differ, images within a tolerance.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path

from iclnuim.channels import CHANNELS, DEPTH, RGB
from iclnuim.console import Console
from iclnuim.sequences.compare import SHARE, SequenceComparison, compare_sequences

from ..options import common


def configure(parser: ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="a run (EXR frames) or a sequence")
    parser.add_argument(
        "b", type=Path, metavar="B", help="another run or sequence, of the same kind as A"
    )
    help = "compare within the tolerance even if equal bytes can be expected"
    parser.add_argument("--tolerance", action="store_true", help=help)
    common(parser, "iclnuim compare out/living_room/kt2/clean elsewhere/kt2/clean")


def run(args: Namespace, console: Console) -> int:
    found = compare_sequences(args.a, args.b, args.tolerance)
    how = _how(found)
    if found.same:
        equal = "equal" if found.by_bytes else "equal within the tolerance"
        console.result(found.to_dict(), f"{how}: {equal}")
        return 0
    names = []
    for name, channels in found.different.items():
        names.append(f"{name} ({', '.join(channels) or 'no channel'})")
    lines = [f"{how}:", *_listed("differ", names)]
    lines += _listed("in one folder only", found.only_in_one)
    console.result(found.to_dict(), "\n".join(lines))
    return 3


def _how(found: SequenceComparison) -> str:
    """What was compared, and how."""
    counts = f"{found.images} images and {found.other_files} other files"
    if found.by_bytes:
        return f"{counts} compared byte for byte ({found.reason})"
    colour = CHANNELS[RGB].tolerance
    depth_mm = 1000 * CHANNELS[DEPTH].tolerance
    return (
        f"{counts} compared, images within a tolerance ({found.reason}): "
        f"{colour:g} of 255, {depth_mm:g} mm, {100 * SHARE:g} % of the pixels; "
        f"worst file {100 * found.largest_share:.2g} %"
    )


def _listed(what: str, names: Sequence[str]) -> list[str]:
    """A line with the first ten of the names; none without names."""
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return [f"  {len(names)} {what}: {', '.join(names[:10])}{more}"] if names else []
