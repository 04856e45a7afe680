"""Every sequence format into every other and back: what the table in
docs/reference/sequence_formats.md says that it holds is held.
"""

import re

import numpy as np
import pytest
from iclnuim.channels import DEPTH, RGB
from iclnuim.evaluation.image_error import psnr_db
from iclnuim.formats.images import read_colour8
from iclnuim.sequences.frame_source import frames_with_poses, original_frames, run_frames
from iclnuim.sequences.frames import SequenceFrame
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.sequence_formats import FORMATS, format_of
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence, read_depth_m
from iclnuim.sequences.writer import write_sequence

#: How the table calls colour that is stored with loss, and how much.
JPEG, JPEG_DB = "JPEG, 50 dB", 50.0
#: Grey levels that a JPEG of quality 100 may be off in the ramp of these frames.
JPEG_LEVELS = 4


@pytest.fixture(scope="session")
def table(repository):
    """The rows of the table of formats by their name: column -> text."""
    text = (repository / "docs/reference/sequence_formats.md").read_text()
    text = text.partition("## Formats of sequences")[2].partition("\n## ")[0]
    head, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|")
    ]
    return {row[0].strip("`"): dict(zip(head, row, strict=True)) for row in rows}


def units_of(row):
    """Depth units a metre that a format has for itself; None where it takes any, or metres."""
    fixed = re.search(r"([\d.]+) a metre", row["depth"])
    return float(fixed[1]) if fixed else None


def test_the_table_says_what_the_formats_declare(table):
    assert list(table) == list(FORMATS)
    words = {
        "text": "text",
        "ns": "nanoseconds",
        "ids": "frame ids, 30 a second",
        "numbers": "none, numbers in names",
    }
    frame = SequenceFrame(3, 1.1)
    for name, format in FORMATS.items():
        row = table[name]
        colour, depth = (format.image(frame, kind).rpartition(".")[2] for kind in (RGB, DEPTH))
        assert row["colour"] == {"png": "PNG", "jpg": JPEG}[colour]
        assert ("NPY" in row["depth"]) == (depth == "npy")
        assert row["stamps"] == words[format.limits.stamps]
        assert (row["poses"] == "one a frame") == format.limits.every_pose
        # the original's format refuses others instead of having a scale of its own
        assert units_of(row) == (5000.0 if name == "icl-nuim" else format.limits.fixed_units)


def check_held(table, source, target, there, name):
    """`there`: the folder of `target` made of `source`; both are a format's row of the table and
    its folder.
    """
    (row_a, a), row_b = source, target
    before, after = StoredSequence(a).pairs, StoredSequence(there).pairs
    if row_a["poses"].startswith("none for image 0") and row_b["poses"] == "one a frame":
        before = before[1:]  # that frame was left out
    assert len(before) == len(after), name
    units = [
        StoredSequence(folder).camera.depth_units_per_metre
        for folder, pairs in ((a, before), (there, after))
    ]
    coarser = min(units if "NPY" not in row_a["depth"] + row_b["depth"] else [*units, 1e9])
    for one, other in zip(before, after, strict=True):
        images = read_colour8(one.rgb), read_colour8(other.rgb)
        lossy = (row_a["colour"], row_b["colour"]) == ("PNG", JPEG)
        assert np.abs(images[0].astype(int) - images[1]).max() <= (JPEG_LEVELS if lossy else 0), (
            name
        )
        assert psnr_db(*images) >= (JPEG_DB if lossy else np.inf), name
        if row_a["colour"] == row_b["colour"]:
            assert one.rgb.read_bytes() == other.rgb.read_bytes(), name
        depth = read_depth_m(one.depth, units[0]) - read_depth_m(other.depth, units[1])
        assert np.abs(depth).max() <= 0.5 / coarser + 1e-6, name
    poses = [StoredSequence(folder).truth for folder in (a, there)]
    count = min(map(len, poses))
    first, second = (t.T_world_camera[len(t) - count :] for t in poses)
    motions = [T[0].inverse() @ T for T in (first, second)]
    assert np.abs(motions[0].matrix - motions[1].matrix).max() < 1e-6, name
    moving = ("icl-nuim", "tartanair", "edex")
    if not any(format in name for format in moving):  # these move the world
        assert np.abs(first.matrix - second.matrix).max() < 1e-6, name
    if not row_a["stamps"].startswith(("none", "frame")) and not row_b["stamps"].startswith(
        ("none", "frame")
    ):
        assert [p.written for p in before] == [p.written for p in after], name


EVERY = [
    pytest.param(name, marks=() if name in ("tum", "tartanair") else pytest.mark.slow)
    for name in FORMATS
]


@pytest.fixture(scope="module", params=["sorted", "published"])
def form_and_folder(request, all_formats, shared_run, tmp_path_factory):
    """Both forms of names, and a folder with a sequence in every format with such names."""
    if request.param == "sorted":
        return request.param, all_formats
    out = tmp_path_factory.mktemp("published") / "out"
    settings = SequenceSettings(names=request.param)
    write_sequence(run_frames(shared_run.path), out, settings, tuple(FORMATS))
    return request.param, out


@pytest.mark.parametrize("name", EVERY)
def test_a_format_goes_into_every_other(form_and_folder, table, tmp_path, name):
    form, every = form_and_folder
    folder = every / name
    source = frames_with_poses(original_frames(folder))
    whole = original_frames(folder)
    units = units_of(table[name]) or 5000.0
    for others, frames in (
        ([n for n in FORMATS if FORMATS[n].limits.every_pose], source),
        ([n for n in FORMATS if not FORMATS[n].limits.every_pose and n != "icl-nuim"], whole),
    ):
        out = tmp_path / f"{len(others)}"
        settings = SequenceSettings(depth_units_per_metre=units, names=form)
        write_sequence(frames, out, settings, others, workers=1)
        for other in others:
            check_held(
                table, (table[name], folder), table[other], out / other, f"{name} -> {other}"
            )
    settings = SequenceSettings(names=form)
    write_sequence(whole, tmp_path / "original", settings, ["icl-nuim"], workers=1)
    check_held(
        table,
        (table[name], folder),
        table["icl-nuim"],
        tmp_path / "original",
        f"{name} -> icl-nuim",
    )


@pytest.mark.parametrize("name", FORMATS)
def test_a_folder_is_recognised_by_what_lies_in_it(all_formats, name):
    listed = (
        "tum" if name in ("icl-nuim", "eth3d", "rtabmap") else name
    )  # read by the lists that they share
    assert format_of(all_formats / name).name == listed
    assert StoredSequence(all_formats / name).truth_path is not None
    found = inspect_sequence(all_formats / name)
    assert (
        found.figures["pairs"] == found.figures["rgb_images"] == found.figures["depth_images"] == 4
    )
    # the frames' depth belongs to no room, which is all that is wrong with them
    assert [line for line in found.errors if "do not match" not in line] == []
