"""Frames -> noise -> a sequence on disk: in any order, on any number of cores, resumable, with its recipe.

`frames.jsonl` has one line a finished frame, with the hashes of its images, so that a stopped sequence can go on; recipe.json what decided
the pixels, what made them, what was counted. Same recipe, same bytes.
"""

import contextlib
import json
import os
import platform
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from .. import __version__
from ..errors import InputError, WorkError
from ..formats.files import atomic_write_text, make_folder, read_bytes, read_json, sha256, write_json, writer_died
from ..formats.libraries import first_library
from ..formats.png import BACKENDS, write_png
from ..sensor.models import depth_model, rgb_model
from ..shipped import source_commit
from . import ground_truth
from .depth_units import KINDS, UNITS_PER_METRE
from .frame_pool import FramePool, cores
from .frames import FrameSource, frames_of_run
from .run_folder import RunFolder, refuse_other, run_key
from .sequence_formats import Contents, SequenceFormat, SequenceFrame, sequence_format
from .sequence_options import SequenceSettings, noisy_images

_SCHEMA_VERSION = 1
#: Keys that decide the pixels; the others may differ between two starts.
_IDENTITY = ("schema_version", "source", "camera", "depth_noise", "rgb_noise", "seed", "depth_units_per_metre")
_KEYS = ("kind", *_IDENTITY, "dialects", "versions", "source_commit", "finished", "frames", "invalid_depth_pixels")
#: The files of a frame by kind of image: rgb, depth, and the kinds of ground truth.
Places = dict[str, list[Path]]


@dataclass(frozen=True)
class WrittenSequence:
    """Folders (one a format), frames made now and found finished, and pixels without depth by kind."""

    folders: tuple[Path, ...]
    made: int
    found: int
    invalid_depth: dict[str, int]


@dataclass(frozen=True)
class JournalEntry:
    """Frame number, SHA-256 of both images, how many pixels of rendered depth became 0, by kind, and SHA-256 of ground-truth images, by kind."""

    frame: int
    rgb_sha256: str = ""
    depth_sha256: str = ""
    invalid_depth: dict[str, int] = field(default_factory=dict)
    truth_sha256: dict[str, str] = field(default_factory=dict)

    def to_line(self) -> str:
        """JSON; the last item only where there is any."""
        content = asdict(self)
        if not self.truth_sha256:
            del content["truth_sha256"]
        return json.dumps(content) + "\n"


def read_entries(path: Path) -> dict[int, JournalEntry]:
    """The entries of a journal's whole lines, latest of each frame. The file is left as it is: a process may be writing it."""
    whole = path.read_bytes().rpartition(b"\n")[0] if path.is_file() else b""
    found = {}
    for line in whole.decode("utf-8", "replace").split("\n"):
        with contextlib.suppress(ValueError, TypeError):
            entry = JournalEntry(**json.loads(line))
            found[entry.frame] = entry
    return found


def write_sequence(
    source: FrameSource,
    out: Path | str,
    settings: SequenceSettings | None = None,
    formats: Iterable[str] = ("tum",),
    workers: int | None = None,
    on_frame: Callable[[int], None] = lambda number: None,
) -> WrittenSequence:
    """Write `source` as a sequence into `out`, or go on with the one begun there. As SequenceWriter does."""
    writer = SequenceWriter(source, {Path(out): settings or SequenceSettings()}, formats)
    return writer.write(workers, on_frame)[0]


class SequenceImages:
    """Makes the images of frames for sequences that a SequenceWriter has begun, folder -> settings, in whatever process: what it reads of them
    is read when it is made, and it writes images alone.
    """

    def __init__(
        self, source: FrameSource, sequences: Mapping[Path, SequenceSettings], formats: Iterable[str] = ("tum",)
    ) -> None:
        keep_freed_memory()
        chosen = [sequence_format(name) for name in dict.fromkeys(formats)]
        self.source = source
        self._images = [_Images(source, Path(out), settings, chosen) for out, settings in sequences.items()]

    def make(self, number: int) -> list[JournalEntry | None]:
        """What each sequence lacked of a frame, written (None where it lacked nothing); on any thread. `SequenceWriter.note` what it returns,
        on one thread. Raises InputError for a frame that cannot be read, WorkError where an image cannot be written.
        """
        rgb, depth_z_m = self.source.load(number)
        truth = self.source.truth_images.images(number) if self.source.truth_images else {}
        return [images.make(number, rgb, depth_z_m, truth) for images in self._images]


class SequenceWriter:
    """The same frames under one or several settings, folder -> settings (clean and noisy): each frame is read once.

    With several formats each has a folder of its own below. Frames that stand there whole, by their hash, are skipped.
    Raises InputError where a folder holds other files or another sequence, WorkError where it cannot be made.
    """

    def __init__(
        self, source: FrameSource, sequences: Mapping[Path, SequenceSettings], formats: Iterable[str] = ("tum",)
    ) -> None:
        sequences, formats = {Path(out): settings for out, settings in sequences.items()}, tuple(dict.fromkeys(formats))
        chosen = [sequence_format(name) for name in formats]
        self.source = source
        self.targets = [_Target(source, out, settings, chosen) for out, settings in sequences.items()]
        self.make = SequenceImages(source, sequences, formats).make
        self.missing = [n for n in source.numbers if any(n not in t.finished for t in self.targets)]

    def write(
        self,
        workers: int | None = None,
        on_frame: Callable[[int], None] = lambda number: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> list[WrittenSequence]:
        """Make the missing frames, then lists and recipe of all that are there; [] where `should_stop()` was true after a frame.

        `on_frame(number)` after each. The first error stops the work; finished frames stay. Raises InputError for a frame that cannot
        be read, WorkError where one cannot be written.
        """

        def noted(entries: list[JournalEntry | None]) -> None:
            on_frame(self.note(entries))
            if should_stop():
                pool.stop()

        with FramePool(self.make, min(workers or cores(), len(self.missing) or 1), noted) as pool:
            for number in self.missing:
                pool.add(number)
        return [] if pool.stopped else self.complete()

    def note(self, entries: list[JournalEntry | None]) -> int:
        """Into the journals; the frame's number."""
        new = [(target, entry) for target, entry in zip(self.targets, entries, strict=True) if entry is not None]
        for target, entry in new:
            target.note(entry)
        return new[0][1].frame

    def stands(self, number: int) -> bool:
        """Whether the frame's images, read back, are in every sequence what its journal says."""
        return all(target.stands(number) for target in self.targets)

    def complete(self) -> list[WrittenSequence]:
        """Lists and recipe of all frames, once they are made."""
        return [target.completed() for target in self.targets]


def standing_frames(source: FrameSource, folders: Iterable[Path], formats: Iterable[str]) -> set[int]:
    """Frames of the source whose images, read back, are in every folder what its journal says. Nothing is written."""
    chosen = [sequence_format(name) for name in formats]
    there = [(read_entries(out / "frames.jsonl"), _places(source, _layout(out, chosen))) for out in folders]

    def stands(number: int) -> bool:
        return all(_stands(entries, number, places[number]) for entries, places in there)

    with ThreadPoolExecutor(4) as pool:
        return {n for n, good in zip(source.numbers, pool.map(stands, source.numbers), strict=True) if good}


def writer_of(run: RunFolder, numbers: Iterable[int], wanted: dict) -> SequenceWriter:
    """The writer of sequences of frames that may still have to be rendered; folders and recipes are made now.

    `wanted`, as a worker receives it: {"dialects": [format, ...], "variants": {FOLDER: {"depth": model, "rgb": model, "seed": n,
    "depth_units": units per metre, 5000 where it is left out}}}. Raises InputError, WorkError.
    """
    sequences = {}
    for folder, v in wanted["variants"].items():
        models, units = (depth_model(v["depth"]), rgb_model(v["rgb"])), v.get("depth_units", UNITS_PER_METRE)
        sequences[Path(folder)] = SequenceSettings(*models, v["seed"], units)
    return SequenceWriter(frames_of_run(run, numbers), sequences, wanted["dialects"])


def keep_freed_memory() -> None:
    """Once a large block was freed, glibc keeps what is freed up to that size for the next array instead of giving it
    back to the system and asking anew, page by page: noise takes two thirds of the time. Elsewhere nothing happens.
    """
    np.empty(30 << 20, np.uint8)


class _Images:
    """One sequence: where its images lie, which stood when this was made, how one is made."""

    def __init__(
        self, source: FrameSource, out: Path, settings: SequenceSettings, formats: list[SequenceFormat]
    ) -> None:
        self.source, self.out, self.settings, self.layout = source, out, settings, _layout(out, formats)
        self.journal = out / "frames.jsonl"
        self.entries = read_entries(self.journal)
        self.places = _places(source, self.layout)

    def stands(self, number: int) -> bool:
        """Whether all images of a frame are there as the journal has them."""
        return _stands(self.entries, number, self.places[number])

    def make(
        self, number: int, rgb: np.ndarray, depth_z_m: np.ndarray, truth: dict[str, np.ndarray]
    ) -> JournalEntry | None:
        if self.stands(number):
            return None
        image, units, invalid = noisy_images(rgb, depth_z_m, self.source.camera, number, self.settings)
        images = {"rgb": image, "depth": units, **truth}
        digests = {kind: _write_image(files, images[kind]) for kind, files in self.places[number].items()}
        return JournalEntry(number, digests.pop("rgb"), digests.pop("depth"), invalid, digests)


class _Target(_Images):
    """One sequence being written: begun or gone on with, its journal kept."""

    def __init__(
        self, source: FrameSource, out: Path, settings: SequenceSettings, formats: list[SequenceFormat]
    ) -> None:
        super().__init__(source, out, settings, formats)
        for format in formats:
            format.check(self._contents(source.numbers))
        self.recipe = self._begun()
        data = self.journal.read_bytes() if self.journal.is_file() else b""
        if not data.endswith(b"\n") and data:
            # a line cut short by a crash; in place: a kill in the middle of writing anew would lose all entries
            os.truncate(self.journal, data.rfind(b"\n") + 1)
        self.finished = frozenset(n for n in self.places if self.stands(n))
        images = (path for n in source.numbers for paths in self.places[n].values() for path in paths)
        for folder in sorted({out, *(path.parent for path in images)}):
            make_folder(folder)
            for leftover in folder.glob(".*.tmp.*"):
                if writer_died(leftover):
                    leftover.unlink(missing_ok=True)

    def note(self, entry: JournalEntry) -> None:
        """Append one line to the journal. Raises WorkError where it cannot be written."""
        try:
            with open(self.journal, "a", encoding="utf-8") as file:
                file.write(entry.to_line())
        except OSError as error:
            raise WorkError(f"{self.journal}: cannot write: {error.strerror or error}") from None
        self.entries[entry.frame] = entry

    def completed(self) -> WrittenSequence:
        """Text files and recipe, once all frames asked for are there. The journal gets one line a frame, in order: the same frames leave
        the same file, however often the work was broken off.
        """
        numbers = tuple(sorted(self.finished.union(self.source.numbers)))
        for format, folder in self.layout:
            format.write_texts(folder, self._contents(numbers), format)
            if self.source.truth_images:
                self.source.truth_images.write_tables(folder)
        folders = tuple(folder for _, folder in self.layout)
        every = [self.entries[n].invalid_depth for n in numbers]
        counts = {kind: sum(counts.get(kind, 0) for counts in every) for kind in KINDS}
        atomic_write_text(self.journal, "".join(self.entries[n].to_line() for n in sorted(self.entries)))
        frames = {"count": len(numbers), "first": numbers[0], "last": numbers[-1]}
        counted = {**self.recipe, "finished": True, "frames": frames, "invalid_depth_pixels": counts}
        for folder in {self.out, *folders}:
            write_json(folder / "recipe.json", counted)
        found = len(self.finished.intersection(self.source.numbers))
        return WrittenSequence(folders, len(self.source.numbers) - found, found, counts)

    def _begun(self) -> dict:
        """Make the folder with the recipe of a sequence not yet finished, or resume the one begun there.

        Raises InputError where a file is in the way, where other files lie there, or a sequence of another recipe.
        """
        name, module = first_library("PNG", *BACKENDS)
        library = str(getattr(module, "__version__", None) or getattr(module, "VERSION_STRING", ""))
        versions = {"iclnuim": __version__, "python": platform.python_version(), "numpy": np.__version__, name: library}
        recipe = {
            "schema_version": _SCHEMA_VERSION,
            "kind": "sequence",
            "source": self.source.origin,
            "camera": self.source.camera.to_dict(),
            **self.settings.to_dict(),
            "dialects": [format.name for format, _ in self.layout],
            "versions": versions,
            "source_commit": source_commit(),
            "finished": False,
        }
        out, file = self.out, self.out / "recipe.json"
        if file.is_file():
            _refuse_other_sequence(file, read_recipe(file), recipe)
        elif out.exists() and (not out.is_dir() or any(not p.name.startswith(".") for p in out.iterdir())):
            found = "other files" if out.is_dir() else "a file"
            raise InputError("an empty folder, or a sequence begun there", path=out, found=found, hint="another folder")
        make_folder(out)
        write_json(file, recipe)
        return recipe

    def _contents(self, numbers: tuple[int, ...]) -> Contents:
        frames, truth = tuple(_frame(self.source, n) for n in numbers), self.source.truth_of(numbers)
        return Contents(self.source.camera, frames, truth, self.settings.depth_units_per_metre, self.source.truth_file)


def _layout(out: Path, formats: list[SequenceFormat]) -> list[tuple[SequenceFormat, Path]]:
    """One format lies in `out` itself, several in a folder each."""
    return [(format, out if len(formats) == 1 else out / format.name) for format in formats]


def _places(source: FrameSource, layout: list[tuple[SequenceFormat, Path]]) -> dict[int, Places]:
    """Colour, depth and ground-truth files of every frame, one a format."""
    kinds = ("rgb", "depth", *(ground_truth.KINDS if source.truth_images else ()))
    frames = [_frame(source, number) for number in source.stamps_s]
    return {f.number: {k: [folder / format.image(f, k) for format, folder in layout] for k in kinds} for f in frames}


def _frame(source: FrameSource, number: int) -> SequenceFrame:
    return source.names.get(number) or SequenceFrame(number, source.stamps_s[number])


def _write_image(files: list[Path], image: np.ndarray) -> str:
    """The same image under every name (one a format); its SHA-256."""
    write_png(files[0], image)
    for other in files[1:]:
        other.unlink(missing_ok=True)
        try:
            os.link(files[0], other)
        except OSError:  # a file system without links
            write_png(other, image)
    return sha256(read_bytes(files[0]))


def _stands(entries: Mapping[int, JournalEntry], number: int, files: Places) -> bool:
    """Whether all images of a frame are there as the journal has them."""
    entry = entries.get(number)
    if entry is None:
        return False
    digests = {"rgb": entry.rgb_sha256, "depth": entry.depth_sha256, **entry.truth_sha256}
    try:
        return all(sha256(path.read_bytes()) == digests.get(kind) for kind, paths in files.items() for path in paths)
    except OSError:
        return False


def read_recipe(path: Path) -> dict:
    """A sequence's recipe. Raises InputError for another kind, a newer schema or unknown keys."""
    recipe = read_json(path)
    version = recipe.get("schema_version")
    if recipe.get("kind") != "sequence" or not isinstance(version, int):
        raise InputError("the recipe of a sequence", path=path, found=recipe.get("kind", "another file"))
    if version > _SCHEMA_VERSION:
        raise InputError(f"a recipe of schema {_SCHEMA_VERSION} or older", path=path, found=version)
    unknown = sorted(set(recipe) - set(_KEYS))
    if unknown:
        raise InputError("the keys of a sequence's recipe", path=path, found=", ".join(unknown))
    return recipe


def _refuse_other_sequence(file: Path, old: dict, new: dict) -> None:
    """Of another noise model only the name is reported, not all of its settings."""
    there, asked = _identity(old), _identity(new)
    models = [key for key in asked if key.endswith("_noise model") and there.get(key) != asked[key]]
    settings = tuple(key.removesuffix("model") for key in models)
    reported = [key for key in asked if key in models or not key.startswith(settings)]
    old, new = ({key: values.get(key) for key in reported} for values in (there, asked))
    refuse_other("sequence", file, old, new, "another folder")


def _identity(recipe: dict) -> dict:
    """What decides the pixels, noise settings one by one. Of a run's own recipe that is its key alone."""
    identity = {"iclnuim": recipe.get("versions", {}).get("iclnuim")}
    for key in _IDENTITY:
        value = recipe.get(key)
        noise = value if key.endswith("_noise") and isinstance(value, dict) else None
        identity |= {key: value} if noise is None else {f"{key} {name}": each for name, each in noise.items()}
    run = recipe.get("source", {}).get("run")
    if isinstance(run, dict) and isinstance(run.get("job"), dict):
        identity["source"] = run_key(run)
    return identity
