"""Damaged bags of every kind of file, as poses and as sequences: each gives a valid result or one
line, never anything else.
"""

import shutil

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..formats.test_fuzzed_files import check_sequence, check_trajectory, damaged, read_sequence
from .bag_files import Recording

pytest.importorskip("rosbags")
CAMERA = PinholeCamera(8, 6, 8.0, 8.0, 3.5, 2.5)
WALK = SE3.exp(np.cumsum(np.random.default_rng(0).normal(size=(6, 6)) * 0.1, axis=0))
POSES = np.hstack([WALK.translation, WALK.quat_xyzw])
WORDS = [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\x40"]
#: Name of the bag -> storage and compression of ROS 2, compression of ROS 1.
KINDS = {
    "plain.bag": (),
    "lz4.bag": ("LZ4",),
    "bz2.bag": ("BZ2",),
    "sqlite": ("sqlite3",),
    "sqlite_zstd": ("sqlite3", "MESSAGE"),
    "mcap": ("mcap",),
    "mcap_zstd": ("mcap", "STORAGE"),
}


def write(path) -> None:
    from rosbags import rosbag1, rosbag2

    kind = KINDS[path.name]
    one = path.suffix == ".bag"
    bag = Recording(path) if one else Recording(path, storage=kind[0])
    if one and kind:
        bag.writer.set_compression(rosbag1.Writer.CompressionFormat[kind[0]])
    if not one and len(kind) > 1:
        mode = rosbag2.CompressionMode[kind[1]]
        bag.writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with bag:
        for i in range(6):
            ns = 10**18 + 33_333_333 * i
            bag.image("/c/color", ns, np.full((6, 8, 3), 80, np.uint8), "rgb8")
            bag.image("/c/depth", ns, np.full((6, 8), 2000, np.uint16), "16UC1")
            bag.info("/c/camera_info", ns, CAMERA)
            bag.pose("/odom", "Odometry", ns, POSES[i], "odom", "base")
            bag.imu("/c/imu", ns, POSES[i, :6], "imu")
            bag.transforms("/tf_static", ns, [("base", "optical", POSES[0])])
            bag.transforms("/tf_static", ns, [("optical", "imu", POSES[1])])


def changed_words(data: bytes, seed: list[int], files: int):
    """Versions with one to five changed bytes or words: deeper than where `damaged` is noticed."""
    for number in range(files):
        rng = np.random.default_rng([*seed, number])
        changed = bytearray(data)
        for _ in range(rng.integers(1, 6)):
            at = rng.integers(len(data) - 4)
            if rng.random() < 0.5:
                changed[at] ^= 1 << rng.integers(8)
            else:
                changed[at : at + 4] = WORDS[rng.integers(len(WORDS))]
        yield bytes(changed)


@pytest.mark.parametrize("files", [10, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_are_read_or_refused(tmp_path, monkeypatch, kind, files):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    path = tmp_path / kind
    write(path)
    places = [path] if path.is_file() else sorted(path.iterdir())
    refused = taken = 0
    for place in places:
        whole = place.read_bytes()
        count = files // len(places)
        for mutated in (damaged(whole, [8], count), changed_words(whole, [9], count)):
            for content in mutated:
                place.write_bytes(content)
                for read, check in (
                    (read_trajectory, check_trajectory),
                    (read_sequence, check_sequence),
                ):
                    try:
                        check(read(path))
                        taken += 1
                    except InputError as error:
                        refused += 1
                        assert "\n" not in str(error) and str(tmp_path) in str(error)
                shutil.rmtree(tmp_path / "cache", ignore_errors=True)
        place.write_bytes(whole)
    assert refused and (taken or files < 100)
    assert read_sequence(path)[-1] is not None
