"""Damaged files of predictions: a line or a value, never a crash, and never much memory."""

import cv2
import numpy as np
import pytest
from iclnuim.depth.predictions import Predictions
from iclnuim.errors import IclnuimError
from iclnuim.formats.exr import write_exr
from iclnuim.formats.png import write_png
from iclnuim.sequences.frames import ImagePair

DEPTH = np.linspace(1, 5, 12 * 16).reshape(12, 16)


def write(path):
    depth16 = np.rint(5000 * DEPTH).astype(np.uint16)
    {
        ".npy": lambda: np.save(path, DEPTH),
        ".npz": lambda: np.savez_compressed(path, depth=DEPTH, mask=DEPTH > 2),
        ".png": lambda: write_png(path, depth16),
        ".exr": lambda: write_exr(path, {"Y": DEPTH.astype(np.float32)}),
        ".tiff": lambda: cv2.imwrite(str(path), DEPTH.astype(np.float32)),
    }[path.suffix]()


def mutated(data, rng):
    data = bytearray(data)
    kind = rng.integers(4)
    if kind == 0:
        return bytes(data[: rng.integers(len(data))])
    if kind == 1:
        at = rng.integers(len(data))
        return bytes(data[:at]) + rng.bytes(int(rng.integers(1, 40))) + bytes(data[at:])
    for _ in range(int(rng.integers(1, 8))):
        at = int(rng.integers(min(len(data), 160) if kind == 2 else len(data)))
        data[at] = int(rng.integers(256))
    return bytes(data)


@pytest.mark.parametrize("ending", [".npy", ".npz", ".png", ".exr", ".tiff"])
def test_400_damaged_files_of_each_kind_give_a_line_or_values(tmp_path, ending):
    rng = np.random.default_rng(len(ending))
    path = tmp_path / f"000000{ending}"
    write(path)
    whole = path.read_bytes()
    pair = ImagePair(0, 0.0, tmp_path / "rgb/000000.png", tmp_path / "depth/000000.png")
    refused = 0
    for _ in range(400):
        path.write_bytes(mutated(whole, rng))
        try:
            values = Predictions(tmp_path, [pair], 5000.0)[0]
        except IclnuimError as error:
            assert "\n" not in str(error) and str(path) in str(error)
            refused += 1
        else:
            assert values.ndim == 2 and values.size < 1 << 28
    assert refused > 50
