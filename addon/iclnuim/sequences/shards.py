"""A sequence as shards to publish: tar files that WebDataset and Hugging Face datasets stream, and
beside them lists, camera and ground truth, a dataset card, croissant.json and SHA256SUMS.

A shard has NUMBER.rgb.png, NUMBER.depth.png and NUMBER.json of each frame: WebDataset takes what
stands before the first dot of a name, without its folder's structure, for the name of a sample.
Unpacked into their folder the shards are a sequence in the format tum, whose lists name these
files. The same sequence gives the same bytes.
"""

import json
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..channels import DEPTH, RGB
from ..errors import InputError
from ..formats.files import (
    atomic_write_text,
    file_sha256,
    json_text,
    read_bytes,
    sha256,
    whole_folder,
)
from ..trajectory_files.trajectories import write_trajectory
from .associations import Associations, ImageList, write_associations, write_image_list
from .camera_files import CAMERA
from .croissant import croissant
from .dataset_card import CITATION, dataset_card
from .frames import ImagePair, poses_at
from .imu import write_imu
from .metadata_lines import FILE as METADATA
from .metadata_lines import metadata_of, write_lines
from .packing import (
    CHECKSUMS,
    LICENCE,
    LICENCES,
    MadeImages,
    add_file,
    is_exact,
    licence_text,
    packed_licence,
)
from .recipe import RECIPE
from .stored_sequence import StoredSequence

CARD = "README.md"
CROISSANT = "croissant.json"
TRUTH = "groundtruth.txt"
#: A shard is at most this large: what WebDataset and hubs of data sets advise.
MAX_SHARD_BYTES = 10**9
_BLOCK = tarfile.BLOCKSIZE
_PNG = "a sequence with PNG images"


@dataclass(frozen=True)
class PackedShards:
    """What pack_shards wrote: names of the shards, number of frames, bytes of all files, and the
    SHA-256 of SHA256SUMS.
    """

    shards: tuple[str, ...]
    frames: int
    size: int
    sha256: str


@dataclass(frozen=True)
class _ShardFrame:
    """A frame's key in the shards, and the content of its JSON."""

    key: str
    pair: ImagePair
    about: dict[str, Any]

    def name(self, kind: str) -> str:
        return f"{self.key}.{kind}.png"


def pack_shards(
    folder: Path,
    out: Path,
    licence: str = "",
    author: str = "",
    max_bytes: int = MAX_SHARD_BYTES,
    on_frame: Callable[[], object] = lambda: None,
) -> PackedShards:
    """Write the sequence in `folder` as shards into the new folder `out`. licence: as of
    packed_licence(); max_bytes: of a shard with more than one frame.

    Raises InputError for a folder without a finished recipe, with images that are missing, not PNG,
    or not those that were made, or without a licence, and for an `out` that exists; WorkError if a
    file cannot be written.
    """
    folder = Path(folder)
    out = Path(out)
    licence = packed_licence(folder, licence)
    if out.exists():
        raise InputError("a new folder", path=out, found="an existing one", hint="another {out}")
    name = folder.resolve().name
    sequence = StoredSequence(folder)
    frames = _frames(sequence)
    with whole_folder(out) as part:
        shards = _write_shards(part, folder, name, frames, max_bytes, on_frame)
        _write_texts(part, sequence, frames)
        terms = licence_text(name, licence, author).decode()
        texts = {LICENCE: terms, RECIPE: read_bytes(folder / RECIPE).decode()}
        digests = {file: file_sha256(part / file) for file in (*shards, METADATA)}
        sizes = {file: (part / file).stat().st_size for file in digests}
        about = {"name": name, "licence": licence, "frames": len(frames)}
        about["exact"] = is_exact(folder)
        address = LICENCES[licence][1] if licence in LICENCES else licence
        texts[CROISSANT] = json_text(croissant(about, digests, sizes, address, CITATION)) + "\n"
        texts[CARD] = dataset_card(about, sequence.camera, shards, sum(sizes.values()), terms)
        for file, text in texts.items():
            atomic_write_text(part / file, text)
        written = sorted(path for path in part.iterdir() if path.name != CHECKSUMS)
        lines = [f"{digests.get(p.name) or file_sha256(p)}  {p.name}\n" for p in written]
        atomic_write_text(part / CHECKSUMS, "".join(lines))
        size = sum(path.stat().st_size for path in part.iterdir())
        digest = file_sha256(part / CHECKSUMS)
    return PackedShards(shards, len(frames), size, digest)


def _frames(sequence: StoredSequence) -> list[_ShardFrame]:
    camera = sequence.camera
    poses = poses_at(sequence.stamps_s, sequence.truth)
    found = []
    for pair, pose in zip(sequence.pairs, poses, strict=True):
        for image in (pair.rgb, pair.depth):
            if image.suffix.lower() != ".png":
                hint = "iclnuim convert, to the format tum"
                raise InputError(_PNG, path=image, found=image.suffix, hint=hint)
        key = f"{pair.number:06}"
        rgb = f"{key}.{RGB}.png"
        about = metadata_of(rgb, f"{key}.{DEPTH}.png", pair.stamp_s, camera, pose)
        about = {"number": pair.number, **about, "K": camera.pinhole.K.tolist()}
        found.append(_ShardFrame(key, pair, about))
    return found


def _write_shards(
    part: Path,
    folder: Path,
    name: str,
    frames: list[_ShardFrame],
    max_bytes: int,
    on_frame: Callable[[], object],
) -> tuple[str, ...]:
    """Write the tar files; returns their names."""
    images = MadeImages(folder)
    shards = []
    for number, of_shard in enumerate(_split(frames, max_bytes)):
        shard = f"{name}-{number:06}.tar"
        shards.append(shard)
        with tarfile.open(part / shard, "w", format=tarfile.PAX_FORMAT) as tar:
            for frame in of_shard:
                for kind, path in ((RGB, frame.pair.rgb), (DEPTH, frame.pair.depth)):
                    data = read_bytes(path)
                    images.check(path.relative_to(folder).as_posix(), sha256(data))
                    add_file(tar, frame.name(kind), data)
                add_file(tar, f"{frame.key}.json", json.dumps(frame.about).encode())
                on_frame()
    return tuple(shards)


def _split(frames: list[_ShardFrame], max_bytes: int) -> Iterator[list[_ShardFrame]]:
    """The frames of each shard: as many as fit, at least one."""
    shard: list[_ShardFrame] = []
    used = 2 * _BLOCK  # the end of a tar file
    for frame in frames:
        sizes = [p.stat().st_size for p in (frame.pair.rgb, frame.pair.depth)]
        sizes.append(len(json.dumps(frame.about).encode()))
        needed = sum(_BLOCK + _padded(size, _BLOCK) for size in sizes)
        if shard and _padded(used + needed, tarfile.RECORDSIZE) > max_bytes:
            yield shard
            shard = []
            used = 2 * _BLOCK
        shard.append(frame)
        used += needed
    yield shard


def _padded(size: int, unit: int) -> int:
    return -(-size // unit) * unit


def _write_texts(part: Path, sequence: StoredSequence, frames: list[_ShardFrame]) -> None:
    """Lists, ground truth, camera, readings of an IMU, and metadata.jsonl of the frames."""
    stamps_s = tuple(frame.pair.stamp_s for frame in frames)
    lists = {}
    for place, kind in enumerate((RGB, DEPTH)):
        written = tuple(frame.pair.written[place] for frame in frames)
        names = tuple(frame.name(kind) for frame in frames)
        lists[kind] = ImageList(stamps_s, names, written)
        write_image_list(part / f"{kind}.txt", lists[kind])
    write_associations(part / "associations.txt", Associations(lists[RGB], lists[DEPTH]))
    atomic_write_text(part / CAMERA, json_text(sequence.camera.to_dict()) + "\n")
    truth = sequence.truth
    if truth is not None:
        own = sequence.folder / TRUTH
        if own.is_file():
            atomic_write_text(part / TRUTH, read_bytes(own).decode())
        else:
            write_trajectory(part / TRUTH, truth, "tum")
    if sequence.imu is not None:
        write_imu(part, sequence.imu)
    write_lines(part, [frame.about for frame in frames])
