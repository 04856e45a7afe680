"""`iclnuim pack`: the archive of a sequence to publish, with checksums, licence, preview and recipe."""

import argparse
import tempfile
from pathlib import Path

from iclnuim.dataset.packing import LICENCES, check_packable, pack, packed_names
from iclnuim.formats.files import read_bytes, sha256

from ..console import Console
from ..options import common


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="a finished sequence")
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="default: DIR.tar.gz")
    parser.add_argument("--licence", choices=tuple(LICENCES), default="CC-BY-4.0", help="default: %(default)s")
    parser.add_argument("--author", default="", help="who is to be named")
    parser.add_argument("--no-preview", action="store_true", help="leave preview.png and preview.mp4 out")
    common(parser, "iclnuim pack out/living_room/kt2/noisy -o kt2_noisy.tar.gz")


def run(args: argparse.Namespace, console: Console) -> None:
    out = args.out or args.folder.with_name(f"{args.folder.resolve().name}.tar.gz")
    check_packable(args.folder, args.licence)
    extra: dict[str, bytes] = {}
    if not args.no_preview:
        from iclnuim.report.preview import draw_preview

        with tempfile.TemporaryDirectory() as scratch:
            drawn = draw_preview(args.folder, Path(scratch), console.progress)
            extra = {path.name: read_bytes(path) for path in drawn}
    progress = console.progress(len(packed_names(args.folder)) + 2 + len(extra), "pack", "files")
    count = pack(args.folder, out, args.licence, args.author, extra, lambda name: progress.advance())
    digest = sha256(read_bytes(out))
    values = {"archive": str(out), "files": count, "bytes": out.stat().st_size, "sha256": digest}
    console.result(values, f"{out}: {count} files, {out.stat().st_size / 1e6:.1f} MB, SHA-256 {digest}")
