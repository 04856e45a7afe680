"""metadata.jsonl of a sequence: each frame with its images, camera and pose, as Hugging Face datasets
read it where they are installed.
"""

import json
import shutil

import numpy as np
import pytest
from iclnuim.formats.images import read_colour8
from iclnuim.sequences.metadata import write_metadata
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.stored_sequence import StoredSequence


@pytest.mark.parametrize("name", FORMATS)
def test_each_frame_has_its_images_camera_and_pose(all_formats, tmp_path, name, command_here):
    folder = shutil.copytree(all_formats / name, tmp_path / name)
    command_here("inspect", folder, "--metadata")
    lines = [json.loads(line) for line in (folder / "metadata.jsonl").read_text().splitlines()]
    pairs = StoredSequence(folder).pairs
    truth = StoredSequence(folder).truth
    assert [(folder / line["file_name"], folder / line["depth_file_name"]) for line in lines] == [
        (pair.rgb, pair.depth) for pair in pairs
    ]
    camera = StoredSequence(folder).camera.to_dict()
    for pair, line in zip(pairs, lines, strict=True):
        assert line["stamp_s"] == pair.stamp_s and camera.items() <= line.items()
        at = np.flatnonzero(np.abs(truth.stamps_s - pair.stamp_s) < 1e-4)
        if not at.size:  # image 0 of the format icl-nuim
            assert line["T_world_camera"] is None and pair.number == 0
            continue
        difference = truth.T_world_camera.matrix[at[0]] - line["T_world_camera"]
        assert np.abs(difference).max() < 1e-9


def test_a_tum_sequence_is_written_with_the_lines_that_inspect_writes(all_formats, tmp_path):
    """Poses in groundtruth.txt are rounded."""
    folder = shutil.copytree(all_formats / "tum", tmp_path / "s")
    written = list(map(json.loads, (folder / "metadata.jsonl").read_text().splitlines()))
    (folder / "metadata.jsonl").unlink()
    for ours, other in zip(written, write_metadata(folder).read_text().splitlines(), strict=True):
        other = json.loads(other)
        difference = np.subtract(ours.pop("T_world_camera"), other.pop("T_world_camera"))
        assert ours == other and np.abs(difference).max() < 1e-9


@pytest.mark.parametrize("poses", [0, 1])
def test_frames_without_a_pose_have_none(all_formats, tmp_path, poses):
    folder = shutil.copytree(all_formats / "tum", tmp_path / "s")
    rows = (folder / "groundtruth.txt").read_text().splitlines(keepends=True)
    kept = [row for row in rows if not row.startswith("#")][:poses]
    (folder / "groundtruth.txt").unlink()
    if kept:
        (folder / "groundtruth.txt").write_text("".join(kept))
    lines = write_metadata(folder).read_text().splitlines()
    found = [json.loads(line)["T_world_camera"] is not None for line in lines]
    assert found == [poses == 1, False, False, False]


def test_hugging_face_reads_it(all_formats, tmp_path):
    datasets = pytest.importorskip("datasets")
    folder = shutil.copytree(all_formats / "tum", tmp_path / "s")
    write_metadata(folder)
    given = {"data_dir": str(folder), "cache_dir": str(tmp_path / "cache"), "split": "train"}
    frames = datasets.load_dataset("imagefolder", **given)
    pairs = StoredSequence(folder).pairs
    assert len(frames) == len(pairs)
    camera = StoredSequence(folder).camera
    for frame, pair in zip(frames, pairs, strict=True):
        assert np.array_equal(np.asarray(frame["image"].convert("RGB")), read_colour8(pair.rgb))
        assert np.asarray(frame["depth"]).max() > camera.depth_units_per_metre
        assert np.shape(frame["T_world_camera"]) == (4, 4)
