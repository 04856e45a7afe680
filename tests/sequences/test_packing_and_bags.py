"""Archives and ROS bags: complete, checked by others, the same each time."""

import hashlib
import shutil
import tarfile

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.png import read_depth16, read_rgb8
from iclnuim.sequences.bag_writer import BagSettings, write_rosbag
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.packing import pack, packed_licence
from iclnuim.sequences.writer import write_sequence


@pytest.fixture
def sequence(run, tmp_path):
    return write_sequence(run_frames(run.path), tmp_path / "my_sequence").folders[0]


def test_the_archive_holds_every_file_with_its_checksum_and_is_the_same_each_time(
    sequence, tmp_path
):
    words = {"licence": "CC-BY-4.0", "author": "N. N.", "extra": {"preview.png": b"picture"}}
    count = pack(sequence, tmp_path / "a.tar.gz", **words)
    pack(sequence, tmp_path / "b.tar.gz", **words)
    assert (tmp_path / "a.tar.gz").read_bytes() == (tmp_path / "b.tar.gz").read_bytes()
    with tarfile.open(tmp_path / "a.tar.gz") as tar:
        files = {
            m.name.removeprefix("my_sequence/"): tar.extractfile(m).read() for m in tar.getmembers()
        }
    assert len(files) == count
    rows = [line.split("  ") for line in files["SHA256SUMS"].decode().splitlines()]
    assert {name for _, name in rows} == set(files) - {"SHA256SUMS"}
    assert all(hashlib.sha256(files[name]).hexdigest() == digest for digest, name in rows)
    assert {"recipe.json", "groundtruth.txt", "rgb/000003.png", "preview.png", "README.txt"} <= set(
        files
    )
    assert "frames.jsonl" not in files
    assert "CC-BY-4.0" in files["LICENSE.txt"].decode() and "N. N." in files["LICENSE.txt"].decode()


def test_an_unfinished_or_foreign_folder_is_not_packed(sequence, tmp_path):
    recipe = (sequence / "recipe.json").read_text()
    (sequence / "recipe.json").write_text(recipe.replace('"finished": true', '"finished": false'))
    with pytest.raises(InputError, match="a finished sequence"):
        pack(sequence, tmp_path / "a.tar.gz")
    (sequence / "recipe.json").unlink()
    with pytest.raises(InputError, match="recipe.json"):
        pack(sequence, tmp_path / "a.tar.gz")
    assert not (tmp_path / "a.tar.gz").exists()


def told(archive, name):
    with tarfile.open(archive) as tar:
        return tar.extractfile(next(m for m in tar if m.name.endswith(name))).read().decode()


def test_only_a_sequence_of_our_rooms_has_a_licence_without_being_asked(
    sequence, tmp_path, command_here
):
    out = tmp_path / "my_sequence.tar.gz"
    command = ("pack", sequence, "--no-preview")
    assert command_here("convert", sequence, tmp_path / "mine")[0] == 0
    for folder in (sequence, tmp_path / "mine"):  # a scene of the user's; no scene
        code, _, said = command_here("pack", folder, "--no-preview")
        assert code == 2 and "--licence: expected a licence for these images: CC-BY-4.0" in said
    code, _, said = command_here(*command, "--licence", "two\nlines")
    assert code == 2 and "any other name, found" in said
    code, printed, _ = command_here(*command, "--licence", "of my lab")
    assert code == 0 and "under of my lab" in printed
    assert "is under of my lab (the licence as given).\n" in told(out, "LICENSE.txt")
    recipe = sequence / "recipe.json"
    recipe.write_text(recipe.read_text().replace('"job": {', '"job": {"scene": "office",'))
    code, printed, _ = command_here(*command)
    assert code == 0 and "under CC-BY-4.0" in printed
    assert "(CC-BY-4.0).\nhttps://creative" in told(out, "LICENSE.txt")


def test_only_a_render_with_poses_is_said_to_have_exact_ground_truth(
    sequence, tmp_path, command_here
):
    pack(sequence, tmp_path / "ours.tar.gz", "MIT")
    assert "with exact ground truth, made with ICL-NUIM" in told(
        tmp_path / "ours.tar.gz", "README.txt"
    )
    assert command_here("convert", sequence, tmp_path / "mine")[0] == 0
    (sequence / "groundtruth.txt").unlink()
    for folder in (tmp_path / "mine", sequence):
        pack(folder, tmp_path / "theirs.tar.gz", "MIT")
        about = told(tmp_path / "theirs.tar.gz", "README.txt")
        assert "sequence, written by ICL-NUIM" in about and "truth" not in about


def test_a_link_to_a_file_outside_is_not_published(sequence, tmp_path):
    (tmp_path / "secret").write_text("secret")
    (sequence / "notes.txt").symlink_to(tmp_path / "secret")
    with pytest.raises(InputError, match=r"notes.txt: .*found a link to a file outside"):
        packed_licence(sequence, "CC-BY-4.0")
    (sequence / "notes.txt").unlink()
    (sequence / "notes.txt").symlink_to("groundtruth.txt")
    packed_licence(sequence, "CC-BY-4.0")


def test_no_archive_of_another_origin_kind_or_place_is_written(sequence, tmp_path, command_here):
    default = tmp_path / "my_sequence.tar.gz"
    default.write_bytes(b"downloaded")
    code, _, said = command_here("pack", sequence, "--no-preview", "--licence", "MIT")
    assert (
        code == 2
        and "my_sequence.tar.gz: expected a new file name" in said
        and default.read_bytes() == b"downloaded"
    )
    default.unlink()
    for _ in range(2):  # our own archive is replaced
        assert command_here("pack", sequence, "--no-preview", "--licence", "MIT")[0] == 0
    for out, words in (
        (tmp_path / "a.zip", "an archive named *.tar.gz or *.tgz, found .zip"),
        (sequence / "a.tar.gz", "outside the folder that is packed"),
        (tmp_path / "no/a.tar.gz", "no such folder"),
    ):
        code, _, said = command_here("pack", sequence, "--licence", "MIT", "-o", out)
        assert code == 2 and words in said and not out.exists()


@pytest.mark.parametrize(
    ("harm", "found"),
    [
        (
            lambda s: (s / "rgb/000003.png").unlink(),
            r"expected all images of the sequence, found none of frame 3 \(rgb\)",
        ),
        (
            lambda s: shutil.copy(s / "depth/000002.png", s / "depth/000003.png"),
            "found none of frame 3",
        ),
        (
            lambda s: (s / "depth/000009.png").write_bytes(b"mine"),
            "depth/000009.png: expected the images .* found another image",
        ),
    ],
)
def test_a_sequence_whose_images_are_not_those_that_were_made_is_not_packed(
    sequence, tmp_path, harm, found
):
    harm(sequence)
    with pytest.raises(InputError, match=found):
        pack(sequence, tmp_path / "a.tar.gz", "MIT")
    assert not list(tmp_path.glob("*a.tar*"))


@pytest.mark.parametrize(
    ("ros", "settings"),
    [
        (1, {}),
        (2, {}),
        (1, {"compress_bags": True}),
        (2, {"compress_bags": True, "bag_storage": "mcap"}),
    ],
)
def test_bags_are_read_back_by_rosbags(sequence, tmp_path, ros, settings):
    highlevel = pytest.importorskip("rosbags.highlevel")
    out = tmp_path / ("s.bag" if ros == 1 else "s_ros2")
    assert write_rosbag(sequence, out, ros, BagSettings(**settings)) == 4
    with highlevel.AnyReader([out]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == dict.fromkeys(
            (
                "/camera/rgb/image_color",
                "/camera/rgb/camera_info",
                "/camera/depth/image",
                "/camera/depth/camera_info",
                "/ground_truth/pose",
                "/tf",
            ),
            4,
        )
        messages = {}
        for connection, stamp, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(
                (stamp, reader.deserialize(raw, connection.msgtype))
            )
    stamp, depth = messages["/camera/depth/image"][2]
    assert stamp == 1_066_667_000 == depth.header.stamp.sec * 10**9 + depth.header.stamp.nanosec
    metres = np.nan_to_num(depth.data.view("<f4").reshape(48, 64))
    assert np.abs(metres - read_depth16(sequence / "depth/000002.png") / 5000).max() < 1e-6
    colour = messages["/camera/rgb/image_color"][2][1]
    assert np.array_equal(colour.data.reshape(48, 64, 3), read_rgb8(sequence / "rgb/000002.png"))
    pose = messages["/ground_truth/pose"][3][1].pose
    row = np.loadtxt(sequence / "groundtruth.txt")[3]
    assert np.allclose(
        [pose.position.x, pose.position.y, pose.position.z, pose.orientation.w], row[[1, 2, 3, 7]]
    )
    with pytest.raises(InputError, match="a path that does not exist yet"):
        write_rosbag(sequence, out, ros)
    assert [p for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_each_image_keeps_its_own_stamp_to_the_nanosecond_in_a_bag(sequence, tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    folder, ns = tmp_path / "s", 1305031102_175304123
    shutil.copytree(sequence, folder)
    rows = []
    for i in range(4):
        texts = [
            f"{(ns + 10**8 * i + off) // 10**9}.{(ns + 10**8 * i + off) % 10**9:09}"
            for off in (0, 7_000_001)
        ]
        rows.append(f"{texts[0]} rgb/{i:06}.png {texts[1]} depth/{i:06}.png\n")
    (folder / "associations.txt").write_text("".join(rows))
    (folder / "groundtruth.txt").unlink()
    write_rosbag(folder, tmp_path / "s_ros2", 2)
    with highlevel.AnyReader([tmp_path / "s_ros2"]) as reader:
        found = {}
        for connection, stamp, _ in reader.messages():
            found.setdefault(connection.topic, []).append(stamp)
    for kind, off in (("rgb/image_color", 0), ("rgb/camera_info", 0), ("depth/image", 7_000_001)):
        assert found[f"/camera/{kind}"] == [ns + 10**8 * i + off for i in range(4)]


def test_bags_that_exist_stay_and_are_said_and_only_new_ones_are_listed(sequence, tmp_path):
    pytest.importorskip("rosbags")
    notes = []
    settings = BagSettings(rosbag=True)
    first = settings.write(sequence, tmp_path / "clean", notes.append)
    again = settings.write(sequence, tmp_path / "clean", notes.append)
    assert ([p.name for p in first], again) == (["clean.bag", "clean_ros2"], [])
    assert [note.endswith("is written") for note in notes] == [True, True, False, False]
    assert all("exists already and is not changed; remove it" in note for note in notes[2:])
    assert BagSettings().write(sequence, tmp_path / "other") == []


def test_a_record_that_names_logs_of_elastic_fusion_is_read_unless_it_wants_them():
    record = BagSettings(rosbag=True).to_dict()
    assert BagSettings.from_dict({**record, "klg": False}) == BagSettings(rosbag=True)
    with pytest.raises(
        InputError, match="found klg; try running its command again without this log"
    ):
        BagSettings.from_dict({**record, "klg": True})
