"""The sequences with labels, as the tests of sequences have them, and predictions of their frames."""

import numpy as np
import pytest
from iclnuim import open_sequence
from sequences.conftest import all_formats, labelled_formats, labelled_run, shared_run

__all__ = ["all_formats", "labelled_formats", "labelled_run", "shared_run"]


@pytest.fixture
def truth(labelled_formats):
    """A sequence of four frames with classes, instances and normals."""
    return labelled_formats / "tum"


@pytest.fixture
def predicted(truth, tmp_path):
    """`predicted(change, name)`: a folder with change(true depth in float64, row) of every frame as
    .npy.
    """

    def write(change=lambda depth_m, row: depth_m, name="method"):
        folder = tmp_path / name
        folder.mkdir()
        for row, frame in enumerate(open_sequence(truth)):
            np.save(folder / f"{row:06}.npy", change(frame.depth_z_m.astype(float), row))
        return folder

    return write
