"""COLMAP's binary model, written from its text by its description
(https://colmap.github.io/format.html).
"""

import struct
from pathlib import Path


def made_binary(model: Path) -> None:
    """Replace the text files of a model, which has one PINHOLE, by binary ones."""
    lines = [line for line in (model / "images.txt").read_text().splitlines()[1:] if line.strip()]
    images = [line.split() for line in lines if line.endswith(".png")]
    data = struct.pack("<Q", len(images))
    for number, *pose, camera, name in images:
        data += struct.pack("<I7dI", int(number), *map(float, pose), int(camera))
        data += name.encode() + b"\0" + struct.pack("<Q", 2)
        data += struct.pack("<ddqddq", 1.5, 2.5, -1, 3.5, 4.5, 7)
    (model / "images.bin").write_bytes(data)
    for line in (model / "cameras.txt").read_text().splitlines()[1:]:
        number, _, width, height, *parameters = line.split()
        head = struct.pack("<QIiQQ", 1, int(number), 1, int(width), int(height))
        (model / "cameras.bin").write_bytes(head + struct.pack("<4d", *map(float, parameters)))
    for file in model.glob("*.txt"):
        file.unlink()
