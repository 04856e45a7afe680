"""`iclnuim compare A B`: are these the same frames? To the byte, or by tolerance where processors or Blenders differ."""

import argparse
from dataclasses import asdict
from pathlib import Path

from ..console import Console
from ..farm import sameness
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A", help="a run (EXR frames) or a sequence")
    parser.add_argument("b", type=Path, metavar="B", help="another of the same kind")
    parser.add_argument("--tolerance", action="store_true", help="by tolerance even where equal bytes can be expected")
    common(parser, "iclnuim compare out/living_room/kt2/clean elsewhere/kt2/clean")


def run(args: argparse.Namespace, console: Console) -> int:
    found = sameness.compare(args.a, args.b, args.tolerance)
    console.result({**asdict(found), "same": found.same}, _text(found))
    return 0 if found.same else 3


def _text(found: sameness.Sameness) -> str:
    if found.by_bytes:
        how = f"{found.files} files compared to the byte ({found.why})"
    else:
        tolerance = f"{sameness.COLOUR_OF_255:g} of 255, {1000 * sameness.DEPTH_M:g} mm, {100 * sameness.SHARE:g} % of the pixels"
        how = f"{found.files} files compared by tolerance ({found.why}): {tolerance}; worst file {100 * found.largest_share:.2g} %"
    if found.same:
        return f"{how}: the same"
    differing = [f"{name} ({', '.join(found.channels[name]) or 'no channel'})" for name in found.different]
    names = [*differing, *(f"{name} (in one folder only)" for name in found.only_in_one)]
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    counts = f"{len(found.different)} differ, {len(found.only_in_one)} are in one folder only"
    return f"{how}: {counts}: {', '.join(names[:10])}{more}"
