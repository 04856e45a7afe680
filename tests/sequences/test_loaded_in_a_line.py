"""Folders and shards in the loaders of others, offline: as many frames, equal to ours."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from iclnuim import open_sequence
from iclnuim.formats.png import read_depth16
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.shards import pack_shards
from iclnuim.sequences.writer import write_sequence
from judges import OF_DATA, judged_by


def sums(image):
    return hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()


@pytest.mark.slow
def test_datasets_webdataset_and_mlcroissant_have_our_frames(shared_run, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "home"))
    folder = write_sequence(run_frames(shared_run.path), tmp_path / "seq").folders[0]
    shards = tmp_path / "shards"
    assert len(pack_shards(folder, shards, "CC-BY-4.0", max_bytes=25_000).shards) > 1
    script = Path(__file__).with_name("loaders_judge.py")
    arguments = (script, folder, shards, tmp_path / "cache")
    needed = "datasets, webdataset, mlcroissant"
    said = judged_by("datasets, webdataset and mlcroissant", needed, *arguments, python=OF_DATA)
    found = json.loads(said.splitlines()[-1])
    assert found["errors"] == []
    sequence = open_sequence(folder)
    for loader in ("folder", "shards", "croissant"):
        assert len(found[loader]) == len(sequence) == 4
        for ours, theirs in zip(sequence, found[loader], strict=True):
            assert theirs["rgb"] == sums(ours.rgb) and theirs["stamp_s"] == ours.stamp_s
            assert np.allclose(theirs["pose"], ours.T_world_camera.matrix, atol=1e-9)
    units = [read_depth16(pair.depth) for pair in sequence.pairs]
    for loader in ("folder", "shards", "croissant"):
        assert [frame["depth"] for frame in found[loader]] == [sums(image) for image in units]
    assert [key for key, _, _ in found["webdataset"]] == [f"{n:06}" for n in range(4)]
    files = [hashlib.sha256(pair.depth.read_bytes()).hexdigest() for pair in sequence.pairs]
    assert found["webdataset_depth"] == files
    assert [stamp for _, stamp, _ in found["webdataset"]] == sequence.stamps_s.tolist()
