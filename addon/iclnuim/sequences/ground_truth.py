"""Images of a run in addition to colour and depth, and its table of objects and classes."""

from functools import cached_property
from pathlib import Path

import numpy as np

from ..channels import INSTANCE, Channel, exr_types
from ..errors import InputError
from ..formats.exr import read_exr
from ..formats.files import atomic_write_text, csv_text, read_bytes, read_json, write_json

OBJECTS = "objects.json"
#: The poses of moving objects in every frame, if something moves.
OBJECT_POSES = "object_poses.csv"


class FurtherImages:
    """The images of a run's frames in addition to colour and depth.

    The table of objects is read at first use, so it may be written after this object is made.
    """

    def __init__(self, run: Path, channels: tuple[Channel, ...]) -> None:
        self.run = Path(run)
        self.channels = channels

    @property
    def has_objects(self) -> bool:
        """False until a worker of the run has prepared the scene."""
        return (self.run / OBJECTS).is_file()

    @cached_property
    def objects(self) -> dict:
        """The content of objects.json. Raises InputError if it is missing or has another format."""
        table = read_json(self.run / OBJECTS)
        if not all(isinstance(table.get(key), list) for key in ("objects", "classes")):
            raise InputError("the objects and classes of a scene", path=self.run / OBJECTS)
        return table

    @cached_property
    def _class_numbers(self) -> np.ndarray:
        """(65536,) class number by instance number."""
        found = np.zeros(1 << 16, np.uint16)
        for thing in self.objects["objects"]:
            found[thing["id"]] = thing["class_id"]
        return found

    def images(self, number: int) -> dict[str, np.ndarray]:
        """The images of a frame by name, as channels.py describes them.

        Raises InputError if a channel of its file is missing.
        """
        path = self.run / "exr" / f"{number:06}.exr"
        exr = read_exr(path)
        missing = [name for name in exr_types(self.channels) if name not in exr]
        if missing:
            raise InputError(
                "a frame with ground truth", path=path, found=f"no {', '.join(missing)}"
            )
        return {c.name: c.read(exr, lambda: self._class_numbers) for c in self.channels}

    def write_tables(self, folder: Path) -> None:
        """Write objects.json, object_poses.csv if something moves, and classes.csv: the names of
        the numbers in class/, and their NYU40 labels; nothing if the images have no instances.
        """
        if INSTANCE not in exr_types(self.channels):
            return
        write_json(folder / OBJECTS, self.objects)
        if (self.run / OBJECT_POSES).is_file():
            poses = read_bytes(self.run / OBJECT_POSES).decode()
            atomic_write_text(folder / OBJECT_POSES, poses)
        keys = ("id", "name", "nyu40_id", "nyu40")
        rows = [[kind[key] for key in keys] for kind in self.objects["classes"]]
        text = csv_text([("class_id", "class", "nyu40_id", "nyu40"), *rows])
        atomic_write_text(folder / "classes.csv", text)
