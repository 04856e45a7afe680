"""Damaged files of each format, two hundred and, slow, two thousand: each gives a valid result or
InputError, never anything else.
"""

import json
import shutil
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from iclnuim import frames_from
from iclnuim.benchmark.fusion.reconstruction import read_reconstruction
from iclnuim.errors import InputError
from iclnuim.formats.images import read_colour8
from iclnuim.formats.meshes import read_mesh_or_cloud
from iclnuim.formats.png import chunk, write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.labels import classes as label_classes
from iclnuim.labels.classes import read_class_map
from iclnuim.labels.images import read_label_image
from iclnuim.sequences.associations import (
    Associations,
    ImageList,
    read_associations,
    read_image_list,
    write_associations,
    write_image_list,
)
from iclnuim.sequences.frames import ImagePair
from iclnuim.sequences.rendered_views import read_keyframes
from iclnuim.sequences.sequence_formats import FORMATS as LAYOUTS
from iclnuim.sequences.stored_sequence import StoredSequence, read_depth_m
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import FORMATS, read_trajectory, trajectory_text

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
import mesh_files as made  # noqa: E402
from colmap_binary import made_binary  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")
FILES = pytest.mark.parametrize("files", [200, pytest.param(2000, marks=pytest.mark.slow)])
FRAMES = 6
WORDS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"1e308",
    b"0",
    b"",
    b"x",
    b"1_0",
    b"1,5",
    b"\xd9\xa1",
    b"0x10",
    b"9" * 400,
    b"--",
    b"1e-320",
]
WALK = Trajectory.at_rate(
    SE3.exp(np.cumsum(np.random.default_rng(0).normal(size=(FRAMES, 6)) * 0.1, axis=0))
)
CAMERA = "cam_pos = [91, 465, -292]';\ncam_dir = [0.05, -0.29, 0.96]';\ncam_up = [0.01, 0.96, 0.29]';\ncam_angle = 90;\n"

NAMES = {
    name: f"a{known.writer.endings[-1]}" if known.writer.endings else f"a_{known.writer.word}.txt"
    for name, known in FORMATS.items()
    if known.writer
} | {
    "tum-ids": "ids.txt",
    "pov-cameras": "cams/scene_0001.txt",
    "colmap": "images.txt",
    "scannet": "pose/1.txt",
}
NAMES |= {"nerf": "transforms.json", "tum-inverse": "inverse.txt", "tum-wxyz": "wxyz.txt"}
NAMES |= {"open3d": "trajectory.json", "named-columns": "named.csv", "matrix-blocks": "a.log"}
NAMES |= {"tum-unstamped": "poses.txt", "positions": "positions.txt"}
NAMES |= {"record3d": "metadata.json", "polycam": "cameras/1.json"}
#: Read beside whole files of the same folder.
FOLDERS = {"pov-cameras": "scene_0000.txt", "scannet": "0.txt", "polycam": "0.json"}
#: By default half of the damaged files.
FEWER = (
    "scannet",
    "nerf",
    "open3d",
    "record3d",
    "polycam",
    "vslam-lab",
    "tartanair",
    "tum-unstamped",
)


def flip_bytes(rng, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        changed[rng.integers(len(changed))] ^= 1 << rng.integers(8)
    return bytes(changed)


def truncate(rng, data: bytes) -> bytes:
    return data[: rng.integers(len(data))]


def delete_line(rng, data: bytes) -> bytes:
    lines = data.splitlines(keepends=True)
    del lines[rng.integers(len(lines))]
    return b"".join(lines)


def repeat_line(rng, data: bytes) -> bytes:
    lines = data.splitlines(keepends=True)
    lines.insert(rng.integers(len(lines) + 1), lines[rng.integers(len(lines))])
    return b"".join(lines)


def change_columns(rng, data: bytes) -> bytes:
    """One field taken out, doubled, or put elsewhere in its line; sometimes in all lines."""
    lines = [line.split(b" ") for line in data.split(b"\n")]
    picked = range(len(lines)) if rng.random() < 0.3 else [rng.integers(len(lines))]
    kind, place = rng.integers(3), rng.integers(8)
    for k in picked:
        fields = lines[k]
        at = place % len(fields)
        if kind == 0:
            del fields[at]
        elif kind == 1:
            fields.insert(at, fields[at])
        else:
            fields.append(fields.pop(at))
    return b"\n".join(b" ".join(fields) for fields in lines)


def put_word(rng, data: bytes) -> bytes:
    """A field becomes something that is no usual number."""
    for parting in rng.permutation([b" ", b",", b"="]):
        fields = data.split(parting)
        if len(fields) > 1:
            fields[rng.integers(len(fields))] = WORDS[rng.integers(len(WORDS))]
            return parting.join(fields)
    return data


def put_bytes(rng, data: bytes) -> bytes:
    at = rng.integers(len(data) + 1)
    return (
        data[:at]
        + bytes(
            rng.choice(list(b"\r\n\t\v\f\0 ,#\"'\x1c\x85\xc2\xa0\xff"), rng.integers(1, 4)).astype(
                "u1"
            )
        )
        + data[at:]
    )


MUTATIONS = [flip_bytes, truncate, delete_line, repeat_line, change_columns, put_word, put_bytes]


def damaged(data: bytes, seed: list[int], files: int):
    """`files` versions of `data`, each after one to three mutations."""
    for number in range(files):
        rng = np.random.default_rng([*seed, number])
        changed = data
        for _ in range(rng.integers(1, 4)):
            changed = MUTATIONS[rng.integers(len(MUTATIONS))](rng, changed or b"\n")
        yield changed


def read_all(
    path, data: bytes, seed: list[int], files: int, read, check, folder=None
) -> tuple[int, int]:
    """Reads all damaged versions; how many were taken and how many refused. A numpy warning counts
    as a failure. An error names the file, or one in its `folder`.
    """
    taken = refused = 0
    for changed in damaged(data, seed, files):
        path.unlink(missing_ok=True)  # overwriting a file makes some file systems wait for the disk
        path.write_bytes(changed)
        try:
            result = read()
        except InputError as error:
            refused += 1
            assert "\n" not in str(error) and str(folder or path.parent) in str(error)
        except Exception as error:
            raise AssertionError(f"{changed!r} raised {error!r}") from error
        else:
            taken += 1
            check(result)
    return taken, refused


def check_trajectory(loaded) -> None:
    T, stamps_s = loaded.trajectory.T_world_camera, loaded.trajectory.stamps_s
    assert len(T) == len(stamps_s) > 0
    assert np.isfinite(stamps_s).all() and (np.diff(stamps_s) > 0).all()
    assert np.abs(T.translation).max() <= 1e6
    assert np.abs(np.swapaxes(T.rotation, 1, 2) @ T.rotation - np.eye(3)).max() < 1e-12
    assert (np.linalg.det(T.rotation) > 0).all()


def content_of(format: str) -> bytes:
    if format == "pov-cameras":
        return CAMERA.encode()
    if format == "colmap":
        fields = [line.split() for line in trajectory_text(WALK, "tum").splitlines()[1:]]
        return "".join(
            f"{i} {' '.join(q[7:] + q[4:7] + q[1:4])} 1 {i}.png\n1 2 -1\n"
            for i, q in enumerate(fields)
        ).encode()
    if format == "scannet":
        return b"".join(
            b" ".join(b"%.9f" % value for value in row) + b"\n"
            for row in WALK.T_world_camera[1].matrix
        )
    if format == "nerf":
        matrices = WALK.T_world_camera.matrix.tolist()
        frames = [
            {"file_path": f"images/{i}.png", "transform_matrix": m} for i, m in enumerate(matrices)
        ]
        return json.dumps({"frames": frames}, indent=1).encode()
    if format == "record3d":
        poses = np.hstack([WALK.T_world_camera.quat_xyzw, WALK.positions_m]).tolist()
        return json.dumps({"w": 8, "h": 6, "fps": 30, "poses": poses}, indent=1).encode()
    if format == "polycam":
        rows = enumerate(WALK.T_world_camera[1].matrix[:3].tolist())
        named = {f"t_{i}{k}": value for i, row in rows for k, value in enumerate(row)}
        return json.dumps(named, indent=1).encode()
    if format == "tum-ids":
        return trajectory_text(WALK, "gt.freiburg").encode()
    if format == "tum-inverse":
        return trajectory_text(
            Trajectory(WALK.stamps_s, WALK.T_world_camera.inverse()), "tum"
        ).encode()
    if format == "tum-wxyz":
        fields = [line.split() for line in trajectory_text(WALK, "tum").splitlines()[1:]]
        return "".join(" ".join(q[:4] + q[7:] + q[4:7]) + "\n" for q in fields).encode()
    if format == "open3d":
        cameras = [
            {"class_name": "PinholeCameraParameters", "extrinsic": matrix.T.ravel().tolist()}
            for matrix in WALK.T_world_camera.inverse().matrix
        ]
        content = {"class_name": "PinholeCameraTrajectory", "parameters": cameras}
        return json.dumps(content, indent=1).encode()
    if format == "named-columns":
        names = ",time [us],p_x,p_y,p_z,q_w,q_x,q_y,q_z,note\n"
        fields = [line.split() for line in trajectory_text(WALK, "tum").splitlines()[1:]]
        return (
            names.encode()
            + "".join(
                f"{i},{1e6 * float(q[0]):.0f},{','.join(q[1:4] + q[7:] + q[4:7])},word\n"
                for i, q in enumerate(fields)
            ).encode()
        )
    if format == "matrix-blocks":
        text = ""
        for i, matrix in enumerate(WALK.T_world_camera.matrix):
            rows = "\n".join(" ".join(f"{value:.16f}" for value in row) for row in matrix)
            text += f"{i} {i} {i + 1}\n{rows}\n"
        return text.encode()
    if format in ("tum-unstamped", "positions"):
        fields = [line.split() for line in trajectory_text(WALK, "tum").splitlines()[1:]]
        kept = slice(1, 8) if format == "tum-unstamped" else slice(0, 4)
        return "".join(" ".join(q[kept]) + "\n" for q in fields).encode()
    return trajectory_text(WALK, format).encode()


def test_every_format_is_fuzzed():
    """Bags in tests/sequences/test_fuzzed_bags.py."""
    assert set(NAMES) == set(FORMATS) - {"rosbag"}


@FILES
@pytest.mark.parametrize("format", NAMES)
def test_damaged_trajectories_are_read_or_refused(tmp_path, format, files):
    path = tmp_path / NAMES[format]
    path.parent.mkdir(exist_ok=True)
    if format in FOLDERS:
        (path.parent / FOLDERS[format]).write_bytes(content_of(format))
    source = path.parent if format in FOLDERS else path
    files = files // 2 if format in FEWER and files <= 500 else files
    # half of the damaged files are told apart by name and content, half are read as what they were
    forms = iter([None, format] * files)
    taken, refused = read_all(
        path,
        content_of(format),
        [1],
        files,
        lambda: read_trajectory(source, next(forms), positions_suffice=format == "positions"),
        check_trajectory,
    )
    assert taken > files / 70 and refused > files / 4


@FILES
def test_damaged_associations_are_read_or_refused(tmp_path, files):
    stamps_s = tuple(i / 30 for i in range(FRAMES))
    rgb, depth = (
        ImageList(stamps_s, tuple(f"{kind}/{i}.png" for i in range(FRAMES)))
        for kind in ("rgb", "depth")
    )
    for order in ("tum", "icl-nuim"):
        path = tmp_path / f"{order}.txt"
        write_associations(path, Associations(rgb, depth), order)

        def check(pairs):
            assert len(pairs.rgb) == len(pairs.depth) > 0
            assert np.isfinite(pairs.rgb.stamps_s).all() and np.isfinite(pairs.depth.stamps_s).all()
            assert all("depth" in name.lower() for name in pairs.depth.paths)

        taken, refused = read_all(
            path, path.read_bytes(), [2], files, lambda path=path: read_associations(path), check
        )
        assert taken > files / 70 and refused > files / 4


@FILES
def test_damaged_image_lists_are_read_or_refused(tmp_path, files):
    path = tmp_path / "rgb.txt"
    write_image_list(
        path,
        ImageList(
            tuple(i / 30 for i in range(FRAMES)), tuple(f"rgb/{i}.png" for i in range(FRAMES))
        ),
    )

    def check(images):
        assert (np.diff(images.stamps_s) > 0).all() and np.isfinite(images.stamps_s).all()

    taken, refused = read_all(
        path, path.read_bytes(), [3], files, lambda: read_image_list(path), check
    )
    assert taken > files / 70 and refused > files / 4


@pytest.mark.parametrize("files", [100, pytest.param(2000, marks=pytest.mark.slow)])
def test_damaged_lists_of_keyframes_are_read_or_refused(tmp_path, files):
    path, every = tmp_path / "keyframes.txt", set(range(FRAMES))
    pairs = [
        ImagePair(i, 1 + i / 30, Path(f"rgb/{i:06}.png"), Path(f"depth/{i:06}.png"))
        for i in range(FRAMES)
    ]

    def check(rows):
        assert rows <= every

    for content in (trajectory_text(WALK[::2], "tum"), "# keyframes\n000000\n2\nrgb/000003.png\n"):
        taken, refused = read_all(
            path, content.encode(), [5], files, lambda: read_keyframes(path, pairs), check
        )
        assert taken > files / 40 and refused > files / 8


@FILES
def test_damaged_cameras_are_read_or_refused(tmp_path, files):
    path = tmp_path / "camera.json"
    content = json.dumps(PinholeCamera().to_dict() | {"depth_units_per_metre": 5000}, indent=1)

    def check(camera):
        assert np.isfinite(camera.K).all() and camera.width > 0 and camera.fy > 0

    taken, refused = read_all(
        path, content.encode(), [5], files, lambda: PinholeCamera.read(path), check
    )
    assert taken > files / 70 and refused > files / 4


#: Files of the sequence formats that are damaged in turn.
SEQUENCES = {
    "replica": ("traj.txt", "cam_params.json", "results/frame000001.jpg"),
    "replica-v2": ("traj_w_c.txt", "cam_params.json"),
    "scannet": (
        "frames/pose/000001.txt",
        "frames/intrinsic/intrinsic_depth.txt",
        "frames/intrinsic/extrinsic_color.txt",
    ),
    "colmap-binary": ("sparse/0/images.bin", "sparse/0/cameras.bin"),
    "colmap": ("sparse/0/images.txt", "sparse/0/cameras.txt", "camera.json"),
    "eth3d": ("associated.txt", "calibration.txt", "groundtruth.txt"),
    "vslam-lab": ("rgb.csv", "calibration.yaml", "groundtruth.csv"),
    "tartanair": ("pose_left.txt", "depth_left/000001_left_depth.npy", "camera.json"),
    "rtabmap": ("associations.txt", "camera.json"),
    "euroc": ("mav0/cam0/data.csv", "mav0/cam0/sensor.yaml", "mav0/depth0/sensor.yaml"),
    "tum-vi": ("mav0/cam0/data.csv", "mav0/mocap0/data.csv", "mav0/depth0/sensor.yaml"),
    "nerf": ("transforms.json",),
    "stray-scanner": ("odometry.csv", "camera_matrix.csv"),
    "record3d": ("metadata.json", "depth/000001.exr"),
    "edex": ("stereo.edex", "frame_metadata.jsonl", "gt.txt"),
}


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    """Three frames of 8 x 6 pixels in every format."""
    out = tmp_path_factory.mktemp("sequences")
    camera = PinholeCamera(8, 6, 8.0, 8.0, 3.5, 2.5)
    light, depth_z_m = np.full((6, 8, 3), 0.5, np.float32), np.full((6, 8), 2.0, np.float32)
    source = frames_from(camera, WALK[:3], lambda number: (light, depth_z_m))
    written = tuple(name for name in SEQUENCES if name in LAYOUTS)
    write_sequence(source, out / "all", formats=written, workers=1)
    shutil.copytree(out / "all/colmap", out / "all/colmap-binary")
    made_binary(out / "all/colmap-binary/sparse/0")
    return out / "all"


def read_sequence(folder):
    """All that the commands read."""
    pairs = StoredSequence(folder).pairs
    camera = StoredSequence(folder).camera
    images = [
        (read_colour8(p.rgb), read_depth_m(p.depth, camera.depth_units_per_metre)) for p in pairs
    ]
    return pairs, camera, images, StoredSequence(folder).truth, StoredSequence(folder).imu


def check_sequence(found) -> None:
    pairs, camera, images, truth, imu = found
    assert len(pairs) > 0 and np.isfinite([p.stamp_s for p in pairs]).all()
    assert np.isfinite(camera.pinhole.K).all() and 1 <= camera.depth_units_per_metre <= 1e6
    assert all(
        rgb.dtype == np.uint8 and rgb.ndim == 3 and depth.dtype == np.float32
        for rgb, depth in images
    )
    assert truth is None or np.isfinite(truth.positions_m).all()
    assert imu is None or np.isfinite(imu.stream.readings).all()


@pytest.mark.parametrize("files", [24, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("format", SEQUENCES)
def test_damaged_sequences_are_read_or_refused(sequences, format, files):
    folder, taken, refused = sequences / format, 0, 0
    for name in SEQUENCES[format]:
        whole, count = (folder / name).read_bytes(), -(-files // len(SEQUENCES[format]))
        found = read_all(
            folder / name, whole, [4], count, lambda: read_sequence(folder), check_sequence, folder
        )
        (folder / name).write_bytes(whole)
        taken, refused = taken + found[0], refused + found[1]
    assert refused and (taken or files < 100)
    read_sequence(folder)


#: Files of each kind of mesh that are damaged in turn.
MESHES = {
    "obj": ("continued lines", "coordinates and normals", "negative numbers between vertices"),
    "off": ("plain", "all", "coloured faces"),
    "ply": ("plain", "strips", "big doubles", "strip with restarts", "triangles and quads"),
    "stl": ("two solids", "binary"),
}


def check_mesh(found) -> None:
    points, triangles, colours = found
    assert len(points) and points.shape[1] == 3 and triangles.shape[1] == 3
    assert not len(triangles) or 0 <= triangles.min() <= triangles.max() < len(points)
    assert colours.shape in ((len(points), 0), (len(points), 3))


@FILES
@pytest.mark.parametrize("kind", MESHES)
def test_damaged_meshes_are_read_or_refused(tmp_path, kind, files):
    path = tmp_path / f"a.{kind}"
    taken = 0
    refused = 0
    count = -(-files // len(MESHES[kind]))
    for name in MESHES[kind]:
        whole = made.content(kind, name)
        some = read_all(path, whole, [6], count, lambda: read_mesh_or_cloud(path), check_mesh)
        taken += some[0]
        refused += some[1]
    assert taken > files / 70 and refused > files / 4


def with_checksums(data: bytes) -> bytes:
    """A PNG of the chunks of damaged data, with right checksums, so that more of it is decoded."""
    parts = [data[:8]]
    for kind, content in split_chunks(data):
        parts += chunk(kind, content)
    return b"".join(parts)


def split_chunks(data: bytes):
    place = 8
    while place + 12 <= len(data):
        size = int.from_bytes(data[place : place + 4], "big")
        if place + 12 + size > len(data):
            return
        yield data[place + 4 : place + 8], data[place + 8 : place + 8 + size]
        place += 12 + size


def label_images(path):
    """16-bit grey, colour, and a palette of 4 bits."""
    rng = np.random.default_rng(7)
    write_png(path, rng.integers(0, 1 << 16, (6, 8)).astype(np.uint16))
    yield path.read_bytes()
    write_png(path, rng.integers(0, 256, (6, 8, 3)).astype(np.uint8))
    yield path.read_bytes()
    header = b"\0\0\0\x08\0\0\0\x06\x04\x03\0\0\0"
    rows = b"".join(b"\0" + row.tobytes() for row in rng.integers(0, 256, (6, 4)).astype(np.uint8))
    parts = chunk(b"IHDR", header) + chunk(b"PLTE", rng.bytes(48)) + chunk(b"tRNS", b"\0\x80")
    parts += chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    yield b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@FILES
def test_damaged_label_images_are_read_or_refused(tmp_path, files):
    path = tmp_path / "label.png"
    taken = refused = 0
    for number, whole in enumerate(label_images(path)):
        for k, changed in enumerate(damaged(whole, [8, number], -(-files // 3))):
            path.write_bytes(with_checksums(changed) if k % 2 else changed)
            try:
                found = read_label_image(path)
            except InputError as error:
                refused += 1
                assert "\n" not in str(error) and str(path) in str(error)
                continue
            taken += 1
            assert found.ids is not None or found.colours is not None
            assert found.ids is None or found.ids.dtype == np.uint16
    assert taken and refused > files / 3


@FILES
@pytest.mark.parametrize("name", ["ours", "replica", "colours"])
def test_damaged_tables_of_classes_are_read_or_refused(tmp_path, name, files):
    path = tmp_path / "table.csv"
    lines = ["id,class,truth,thing,red,green,blue", "0,void,,,,,", "1,wall,a|b,0,1,2,3"]
    data = "\n".join([*lines, '7,"a, b",c,,255,0,0', "9,sofa,,1,4,5,6", ""]).encode()
    if name != "colours":
        data = (Path(label_classes.__file__).parent / f"class_maps/{name}.csv").read_bytes()

    def check(table) -> None:
        count = len(table.classes)
        found = table.indices(np.r_[-2:300, 65500:65540]).values
        assert count and found.min() >= 0 and found.max() <= count == len(table.names) - 1

    taken, refused = read_all(path, data, [9], files // 5, lambda: read_class_map(path), check)
    assert taken and refused


@FILES
@pytest.mark.parametrize("of", ["face", "vertex"])
def test_damaged_labels_of_meshes_are_read_or_refused(tmp_path, of, files):
    path = tmp_path / "labels.ply"
    lines = ["ply", "format ascii 1.0", "element vertex 4"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += ["property int label"] * (of == "vertex")
    lines += ["element face 2", "property list uchar int vertex_indices"]
    lines += ["property float class"] * (of == "face") + ["end_header"]
    points = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
    faces = ["4 0 1 2 3", "3 0 1 2"]
    if of == "vertex":
        points = [f"{point} {number}" for number, point in enumerate(points)]
    else:
        faces = [f"{face} {number}" for number, face in enumerate(faces)]
    data = "\n".join([*lines, *points, *faces, ""]).encode()

    def check(mesh) -> None:
        assert mesh.labels.values.dtype == np.int64
        whole = mesh.triangles if mesh.labels.of_triangles else mesh.points
        assert len(mesh.labels.values) == len(whole)

    def read():
        return read_reconstruction(path, labelled=True)

    taken, refused = read_all(path, data, [10], files, read, check)
    assert taken and refused
