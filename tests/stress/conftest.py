"""The textured box as a sequence on disk."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from box_scene import CAMERA, look, segment, truth  # noqa: E402, F401
from iclnuim import frames_from, write_sequence  # noqa: E402


@pytest.fixture(scope="session")
def folder(truth, tmp_path_factory):  # noqa: F811
    folder = tmp_path_factory.mktemp("stress") / "box/clean"
    write_sequence(
        frames_from(CAMERA, truth, lambda n: look(truth.T_world_camera[n])), folder, workers=1
    )
    return folder
