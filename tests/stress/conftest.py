"""The textured box as a sequence on disk."""

import pytest
from box_scene import CAMERA, look, segment, truth  # noqa: F401
from iclnuim import frames_from, make_sequence


@pytest.fixture(scope="session")
def folder(truth, tmp_path_factory):  # noqa: F811
    folder = tmp_path_factory.mktemp("stress") / "box/clean"
    make_sequence(
        frames_from(CAMERA, truth, lambda n: look(truth.T_world_camera[n])), folder, workers=1
    )
    return folder
