"""Fixtures that all rooms' tests share."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def samples() -> Path:
    """The official samples: the folder named by ICLNUIM_SAMPLES, by default beside the checkout."""
    folder = Path(os.environ.get("ICLNUIM_SAMPLES", REPOSITORY.parent / "shared/data/iclnuim"))
    if not (folder / "trajectories").is_dir():
        pytest.skip(f"the official ICL-NUIM samples are not at {folder}; set ICLNUIM_SAMPLES")
    return folder


@pytest.fixture(scope="session")
def repository() -> Path:
    return REPOSITORY
