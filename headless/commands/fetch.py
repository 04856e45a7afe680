"""`iclnuim fetch`: fetches a sequence that `iclnuim pack --shards` packed, from a folder or a web
server.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.sequences.fetching import fetch, source_of, unpack

from ..options import common


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "a folder with SHA256SUMS, or its address (http or https)"
    add("source", metavar="FOLDER|URL", help=help)
    help = "a new folder, or one to continue; default: the name of the source, here"
    add("-o", "--out", type=Path, metavar="OUT", help=help)
    help = "SHA-256 of SHA256SUMS, as `iclnuim pack --shards` prints it"
    add("--sha256", default="", metavar="DIGEST", help=help)
    help = "also unpack the shards, so that OUT is a sequence in the format tum"
    add("--unpack", action="store_true", help=help)
    common(parser, "iclnuim fetch https://example.org/kt2_noisy --unpack")


def run(args: Namespace, console: Console) -> None:
    source = source_of(args.source)
    out = args.out or Path(_name(args.source))
    if Path(args.source).exists() and out.exists() and out.samefile(args.source):
        raise InputError("another folder than the source", setting="out", found=out)
    progress = None

    def on_file(name: str, done: int, total: int) -> None:
        nonlocal progress
        progress = progress or console.progress(total, "fetch", "files")
        progress.advance()

    found = fetch(source, out, args.sha256, on_file)
    values = {
        "folder": str(out),
        "fetched": len(found.fetched),
        "already_there": len(found.found),
        "unpacked": unpack(out) if args.unpack else 0,
    }
    text = f"{out}: {len(found.fetched)} files fetched, {len(found.found)} found, all verified"
    if args.unpack:
        text += f"; {values['unpacked']} files unpacked"
    console.result(values, text)


def _name(source: str) -> str:
    """The last part of a path or an address."""
    name = PurePosixPath(urlsplit(source).path.rstrip("/")).name or Path(source).resolve().name
    if name in ("", ".", ".."):
        raise InputError("a folder to write", setting="out", found="none")
    return name
