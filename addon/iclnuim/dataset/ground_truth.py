"""Ground-truth images in addition to colour and depth: instance/, class/, normal/, and the table of
objects and classes.
"""

from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.exr import read_exr
from ..formats.files import atomic_write_text, read_json, write_json

#: Folders of a sequence, in addition to rgb and depth. All three contain 16-bit PNG.
KINDS = ("instance", "class", "normal")
OBJECTS = "objects.json"
#: Float channels of an EXR frame. Where a ray hits nothing, instance is 0 and normal (0, 0, 0).
#: Normals are in the cv camera's frame.
INSTANCE, NORMAL = "instance", ("normal.X", "normal.Y", "normal.Z")
CHANNELS = (INSTANCE, *NORMAL)
#: A component c of a normal is stored as NORMAL_ZERO + c * NORMAL_STEPS; 0 0 0 where nothing is
#: seen. Rounding rotates it by at most 0.0015 degrees.
NORMAL_ZERO, NORMAL_STEPS = 32768, 32767


def normal16(normal: np.ndarray) -> np.ndarray:
    """Encode unit normals (h, w, 3), (0, 0, 0) where there is none, as (h, w, 3) uint16."""
    steps = np.rint(normal.astype(float) * NORMAL_STEPS) + NORMAL_ZERO
    return np.where(np.any(normal != 0, -1, keepdims=True), steps, 0).astype(np.uint16)


class TruthImages:
    """The ground truth of a run's frames.

    The table of objects is read at first use, so it may be written after this object is made.
    """

    def __init__(self, run: Path) -> None:
        self.run = Path(run)

    @cached_property
    def objects(self) -> dict:
        """The content of objects.json. Raises InputError if it is missing or has another format."""
        table = read_json(self.run / OBJECTS)
        if not all(isinstance(table.get(key), list) for key in ("objects", "classes")):
            raise InputError("the objects and classes of a scene", path=self.run / OBJECTS)
        return table

    @cached_property
    def _class_of(self) -> np.ndarray:
        """(65536,) class number by instance number."""
        found = np.zeros(1 << 16, np.uint16)
        for thing in self.objects["objects"]:
            found[thing["id"]] = thing["class_id"]
        return found

    def images(self, number: int) -> dict[str, np.ndarray]:
        """(h, w) uint16 instance and class, (h, w, 3) uint16 normal of a frame.

        Raises InputError if its channels are missing.
        """
        path = self.run / "exr" / f"{number:06}.exr"
        channels = read_exr(path)
        missing = [name for name in CHANNELS if name not in channels]
        if missing:
            raise InputError(
                "a frame with ground truth", path=path, found=f"no {', '.join(missing)}"
            )
        instance = channels[INSTANCE].astype(np.uint16)
        normal = normal16(np.stack([channels[name] for name in NORMAL], -1))
        return {"instance": instance, "class": self._class_of[instance], "normal": normal}

    def write_tables(self, folder: Path) -> None:
        """Write objects.json, and classes.csv: the names of the numbers in class/, and their NYU40
        labels.
        """
        write_json(folder / OBJECTS, self.objects)
        rows = [
            f"{c['id']},{c['name']},{c['nyu40_id']},{c['nyu40']}" for c in self.objects["classes"]
        ]
        atomic_write_text(
            folder / "classes.csv", "\n".join(["class_id,class,nyu40_id,nyu40", *rows]) + "\n"
        )
