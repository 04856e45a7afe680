"""The registry of sequence formats. A new format is a module in layouts/ and an entry here; the
command line, the panel and the documentation list these entries.
"""

from pathlib import Path

from ..errors import InputError
from . import bag_reader
from .format import SequenceFormat
from .layouts import (
    colmap,
    edex,
    eth3d,
    euroc,
    icl_nuim,
    nerf,
    numbered,
    phones,
    replica,
    scannet,
    tartanair,
    tum,
    tum_vi,
    vslam_lab,
)

_ALL = (
    tum.FORMAT,
    icl_nuim.FORMAT,
    euroc.FORMAT,
    nerf.FORMAT,
    replica.FORMAT,
    replica.V2,
    scannet.FORMAT,
    colmap.FORMAT,
    eth3d.FORMAT,
    vslam_lab.FORMAT,
    tartanair.FORMAT,
    tum.RTABMAP,
    edex.FORMAT,
    phones.STRAY_SCANNER,
    phones.RECORD3D,
    tum_vi.FORMAT,
)
#: Formats that are only read. A folder of one of these may also have what another format has, so
#: they are tried after the others.
READ_ONLY = (
    phones.POLYCAM,
    numbered.TRIPLES,
    numbered.OPEN3D,
)
#: name -> format, in the order in which they are tried when a folder's format is detected
FORMATS = {format.name: format for format in _ALL}


def sequence_format(name: str) -> SequenceFormat:
    """The format of this name. Raises InputError for an unknown name."""
    if name not in FORMATS:
        raise InputError(f"a sequence format ({', '.join(FORMATS)})", found=name)
    return FORMATS[name]


def format_of(folder: Path) -> SequenceFormat:
    """The format of a folder, or of a bag, which is only read. If none is detected, tum, whose
    reader reports what is missing.
    """
    if bag_reader.FORMAT.reader.found(folder):
        return bag_reader.FORMAT
    formats = (*FORMATS.values(), *READ_ONLY)
    return next((format for format in formats if format.reader.found(folder)), tum.FORMAT)
