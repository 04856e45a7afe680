"""`iclnuim pack`: writes the archive of a sequence to publish."""

import tempfile
from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import check_file, is_stream, read_bytes, real_path, sha256
from iclnuim.sequences.packing import LICENCES, is_archive, pack, packed_licence, packed_names

from ..options import common
from ..outputs import refuse_existing

#: Endings of the archive.
_ARCHIVES = (".tar.gz", ".tgz")


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="a finished sequence")
    add("-o", "--out", type=Path, metavar="FILE", help="a .tar.gz; default: DIR.tar.gz")
    help = (
        f"{', '.join(LICENCES)}, or the name of any other; required for other images than renders "
        "of our rooms, which are under CC-BY-4.0"
    )
    add("--licence", default="", metavar="NAME", help=help)
    add("--author", default="", help="name of the author in the archive")
    add("--no-preview", action="store_true", help="leave out preview.png and preview.mp4")
    help = (
        "write a folder with shards (tar files of at most 1 GB) that WebDataset and Hugging Face "
        "datasets stream, and what belongs to them; default: DIR_shards"
    )
    add("--shards", action="store_true", help=help)
    example = "iclnuim pack out/living_room/kt2/noisy -o kt2_noisy.tar.gz"
    common(parser, example)


def _check_archive(args: Namespace, out: Path) -> None:
    """Raises InputError for another kind of archive, one inside the folder, and, if the user did
    not name it, for a file of another origin.
    """
    if not out.name.endswith(_ARCHIVES) and not is_stream(out):
        expected = f"an archive named *{' or *'.join(_ARCHIVES)}"
        raise InputError(expected, path=out, found=out.suffix or "no ending")
    if real_path(out).is_relative_to(real_path(args.folder)):
        expected = "an archive outside the folder that is packed"
        raise InputError(expected, path=out, found="a file in it", hint="another {out}")
    if not args.out and out.exists() and not is_archive(out):
        refuse_existing(out, "-o FILE")
    check_file(out)


def _pack_shards(args: Namespace, folder: Path, console: Console) -> None:
    from iclnuim.sequences.shards import pack_shards
    from iclnuim.sequences.stored_sequence import StoredSequence

    out = args.out or folder.with_name(f"{real_path(folder).name}_shards")
    if real_path(out).is_relative_to(real_path(args.folder)):
        expected = "a folder outside the one that is packed"
        raise InputError(expected, path=out, found="one in it", hint="another {out}")
    licence = packed_licence(args.folder, args.licence)
    progress = console.progress(len(StoredSequence(args.folder).pairs), "pack")
    found = pack_shards(folder, out, licence, args.author, on_frame=progress.advance)
    values = {
        "folder": str(out),
        "shards": list(found.shards),
        "frames": found.frames,
        "bytes": found.size,
        "sha256": found.sha256,
        "licence": licence,
    }
    text = (
        f"{out}: {found.frames} frames in {len(found.shards)} shards, {found.size / 1e6:.1f} MB, "
        f"under {licence}; SHA-256 of SHA256SUMS {found.sha256}"
    )
    console.result(values, text)


def run(args: Namespace, console: Console) -> None:
    folder = args.folder if args.folder.name else real_path(args.folder)  # `.` has no name
    if args.shards:
        _pack_shards(args, folder, console)
        return
    out = args.out or folder.with_name(f"{real_path(folder).name}.tar.gz")
    licence = packed_licence(args.folder, args.licence)
    _check_archive(args, out)
    extra: dict[str, bytes] = {}
    if not args.no_preview:
        from iclnuim.report.preview import draw_preview

        with tempfile.TemporaryDirectory() as scratch:
            drawn = draw_preview(args.folder, Path(scratch), console.progress)
            extra = {path.name: read_bytes(path) for path in drawn}
    progress = console.progress(len(packed_names(args.folder)) + 2 + len(extra), "pack", "files")

    def on_file(name: str) -> None:
        progress.advance()

    count = pack(args.folder, out, licence, args.author, extra, on_file)
    digest = sha256(read_bytes(out))
    size = out.stat().st_size
    values = {"archive": str(out), "files": count, "bytes": size, "sha256": digest}
    values["licence"] = licence
    text = f"{out}: {count} files, {size / 1e6:.1f} MB, under {licence}, SHA-256 {digest}"
    console.result(values, text)
