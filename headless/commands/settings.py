"""`iclnuim settings SYSTEM DIR`: writes the settings file that a SLAM system needs for a
sequence.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.formats.files import atomic_write_text

from ..loader_settings import filled, system_files, systems
from ..options import common


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("system", metavar="SYSTEM", help=", ".join(systems()))
    add("folder", type=Path, metavar="DIR", help="sequence in the format that the system reads")
    help = "mesh of the room, for its bounds; default: the surfaces in the depth images"
    add("--model", type=Path, metavar="MESH", help=help)
    help = "folder for the files; default: DIR"
    add("-o", "--out", type=Path, metavar="FOLDER", help=help)
    common(parser, "iclnuim settings nice-slam replica_kt2")


def run(args: Namespace, console: Console) -> None:
    out = args.out or args.folder
    texts = filled(system_files(args.system), args.folder, args.model)
    for name, text in texts.items():
        atomic_write_text(out / name, text)
    files = [str(out / name) for name in texts]
    console.result({"files": files}, "\n".join(files))
