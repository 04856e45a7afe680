"""Shards of a sequence: what others load, the same each time, and a sequence again when unpacked."""

import hashlib
import json
import subprocess
import tarfile

import numpy as np
import pytest
from iclnuim import open_sequence
from iclnuim.errors import InputError
from iclnuim.sequences.croissant import croissant
from iclnuim.sequences.fetching import unpack
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.shards import pack_shards
from iclnuim.sequences.writer import write_sequence


@pytest.fixture
def sequence(shared_run, tmp_path):
    return write_sequence(run_frames(shared_run.path), tmp_path / "my_sequence").folders[0]


def members(path):
    with tarfile.open(path) as tar:
        return {member.name: tar.extractfile(member).read() for member in tar}


def test_a_shard_has_the_images_and_a_json_of_each_frame(sequence, tmp_path):
    found = pack_shards(sequence, tmp_path / "out", "CC-BY-4.0")
    assert found.shards == ("my_sequence-000000.tar",) and found.frames == 4
    files = members(tmp_path / "out" / found.shards[0])
    assert list(files)[:3] == ["000000.rgb.png", "000000.depth.png", "000000.json"]
    for number, frame in enumerate(open_sequence(sequence)):
        for kind in ("rgb", "depth"):
            image = files[f"{number:06}.{kind}.png"]
            assert image == (sequence / kind / f"{number:06}.png").read_bytes()
        about = json.loads(files[f"{number:06}.json"])
        assert about["stamp_s"] == frame.stamp_s and about["number"] == number
        assert np.allclose(about["T_world_camera"], frame.T_world_camera.matrix, atol=1e-9)
        assert np.array_equal(about["K"], open_sequence(sequence).camera.K)


def test_unpacked_in_its_folder_it_is_the_sequence(sequence, tmp_path):
    out = tmp_path / "out"
    pack_shards(sequence, out, "CC-BY-4.0")
    assert unpack(out) == 12 and unpack(out) == 12
    ours, theirs = open_sequence(sequence), open_sequence(out)
    assert theirs.camera == ours.camera and len(theirs) == 4
    assert (out / "groundtruth.txt").read_bytes() == (sequence / "groundtruth.txt").read_bytes()
    for a, b in zip(ours, theirs, strict=True):
        assert a.stamp_s == b.stamp_s
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth_z_m, b.depth_z_m)
        assert np.array_equal(a.T_world_camera.matrix, b.T_world_camera.matrix)


def test_the_same_sequence_gives_the_same_bytes_and_their_sums(sequence, tmp_path):
    first = pack_shards(sequence, tmp_path / "a", "CC-BY-4.0", "N. N.")
    second = pack_shards(sequence, tmp_path / "b", "CC-BY-4.0", "N. N.")
    assert first == second
    files = {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "b").iterdir()}
    checked = subprocess.run(
        ["sha256sum", "-c", "SHA256SUMS"], cwd=tmp_path / "a", capture_output=True, text=True
    )
    assert checked.returncode == 0 and checked.stdout.count(": OK") == len(files) - 1
    assert hashlib.sha256(files["SHA256SUMS"]).hexdigest() == first.sha256
    assert first.size == sum(map(len, files.values()))


def test_a_shard_is_at_most_as_large_as_is_asked_for(sequence, tmp_path):
    whole = pack_shards(sequence, tmp_path / "one", "CC-BY-4.0")
    size = (tmp_path / "one" / whole.shards[0]).stat().st_size
    found = pack_shards(sequence, tmp_path / "some", "CC-BY-4.0", max_bytes=int(0.7 * size))
    assert 1 < len(found.shards) < 4
    assert all((tmp_path / "some" / s).stat().st_size <= 0.7 * size for s in found.shards)
    every = pack_shards(sequence, tmp_path / "every", "CC-BY-4.0", max_bytes=1)
    assert len(every.shards) == 4  # a frame is never divided
    joined = {}
    for shard in every.shards:
        joined |= members(tmp_path / "every" / shard)
    assert joined == members(tmp_path / "one" / whole.shards[0])


def test_the_card_says_size_licence_origin_and_citation(sequence, tmp_path, command_here):
    code, text, _ = command_here(
        "pack", sequence, "--shards", "--licence", "of my lab", "-o", tmp_path / "out", "--json"
    )
    assert code == 0 and json.loads(text)["frames"] == 4
    card = (tmp_path / "out/README.md").read_text()
    for words in ('license_name: "of my lab"', "4 frames, 64 x 48 pixels", "handa2014benchmark"):
        assert words in card
    assert 'data_files: "*.tar"' in card and "exact ground truth" in card
    assert "of my lab" in (tmp_path / "out/LICENSE.txt").read_text()


def test_shards_are_written_into_a_new_folder_alone(sequence, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="a new folder"):
        pack_shards(sequence, tmp_path / "mine", "CC-BY-4.0")
    assert (tmp_path / "mine/thesis.txt").read_text() == "mine"
    png = sequence / "rgb/000002.png"
    png.write_bytes((sequence / "rgb/000001.png").read_bytes()[:-1] + b"x")
    with pytest.raises(InputError, match="images that were made with the sequence"):
        pack_shards(sequence, tmp_path / "out", "CC-BY-4.0")
    assert not (tmp_path / "out").exists() and not list(tmp_path.glob(".*"))


def test_formats_with_other_images_are_told_to_convert(shared_run, tmp_path):
    out = write_sequence(run_frames(shared_run.path), tmp_path / "r", formats=("replica",))
    with pytest.raises(InputError, match="PNG images.*convert"):
        pack_shards(out.folders[0], tmp_path / "out", "CC-BY-4.0")


def test_croissant_lists_every_file_with_its_sum():
    digests = {"a-000000.tar": "1" * 64, "metadata.jsonl": "2" * 64}
    sizes = {"a-000000.tar": 10240, "metadata.jsonl": 9}
    about = {"name": "a", "frames": 2}
    content = croissant(about, digests, sizes, "https://example.org/licence", "citation")
    files = {d["name"]: d for d in content["distribution"] if d["@type"] == "cr:FileObject"}
    assert {name: file["sha256"] for name, file in files.items()} == digests
    assert files["a-000000.tar"]["contentSize"] == "10240 B"
