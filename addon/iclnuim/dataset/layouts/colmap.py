"""COLMAP's text model, for splatting programs: images/, sparse/0/ with cameras.txt, images.txt,
points3D.txt, and test.txt.

COLMAP has no depth: we add it in depth/ and camera.json. COLMAP's pixel centres are at +0.5, its
poses are world to camera, scalar first (https://colmap.github.io/format.html). test.txt lists every
8th image, the same that 3D Gaussian splatting holds out by default.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError
from ...formats import colmap
from ...formats.files import atomic_write_text, data_lines, is_file, make_folder, read_text
from ...geometry.camera import PinholeCamera
from ..layout import Contents, Reader, Row, SequenceCamera, SequenceFormat, camera_file, numbers_in
from . import listed

_MODELS = ("sparse/0", "sparse")
_FOLDERS = {RGB: "images"}
#: Maximum number of images that points are taken from,
_VIEWS = 40
#: of images among them in which each point is searched,
_WITNESSES = 8
#: and of points.
_POINTS = 20_000
#: Maximum relative difference of depth in another image if it is the same surface.
_SAME_SURFACE = 0.01
_HELD_OUT = 8


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    model = folder / _MODELS[0]
    c = contents.camera
    make_folder(model)
    listed.write_camera(folder, contents)
    camera = f"1 PINHOLE {c.width} {c.height} {c.fx!r} {c.fy!r} {c.cx + 0.5!r} {c.cy + 0.5!r}\n"
    atomic_write_text(model / "cameras.txt", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + camera)
    names = [Path(path).name for path in format.images(contents, RGB).paths]
    points, tracks = _points(contents)
    seen: list[list[str]] = [[] for _ in names]
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    for number, (point, track) in enumerate(zip(points, tracks, strict=True), 1):
        places = []
        for image, u, v in track:
            places.append(f"{image + 1} {len(seen[image])}")
            seen[image].append(f"{u + 0.5:.4f} {v + 0.5:.4f} {number}")
        lines.append(f"{number} {point} 0 {' '.join(places)}")
    atomic_write_text(model / "points3D.txt", "\n".join(lines) + "\n")
    head = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[] as (X, Y, POINT3D_ID)"
    lines = [head]
    poses = contents.poses.inverse()
    rows = zip(names, poses.quat_xyzw.tolist(), poses.translation.tolist(), strict=True)
    for image, (name, (x, y, z, w), t) in enumerate(rows):
        numbers = " ".join(f"{value + 0.0:.12f}" for value in (w, x, y, z, *t))
        lines += [f"{image + 1} {numbers} 1 {name}", " ".join(seen[image])]
    atomic_write_text(model / "images.txt", "\n".join(lines) + "\n")
    held_out = [f"{name}\n" for name in sorted(names)[::_HELD_OUT]]
    atomic_write_text(model / "test.txt", "".join(held_out))


#: The track of a point: the row of an image and the pixel (u, v) where it is seen, centres at whole
#: numbers.
_Track = list[tuple[int, float, float]]


def _points(contents: Contents) -> tuple[list[str], list[_Track]]:
    """`X Y Z R G B` of points on the surface, and their tracks.

    Points are pixels on a grid; each is also searched in some other views.
    """
    if contents.surface is None:
        return [], []
    rows = list(range(0, len(contents.frames), math.ceil(len(contents.frames) / _VIEWS)))
    views = [contents.surface(contents.frames[row].number) for row in rows]
    camera = contents.camera
    poses = contents.poses
    step = max(1, math.ceil(math.sqrt(len(rows) * camera.width * camera.height / _POINTS)))
    texts: list[str] = []
    tracks: list[_Track] = []
    grid = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
    witnesses = list(zip(rows, views, strict=True))[:: math.ceil(len(rows) / _WITNESSES)]
    for row, (rgb, depth_z_m) in zip(rows, views, strict=True):
        v, u = grid.reshape(2, -1)
        measured = np.isfinite(depth_z_m[v, u]) & (depth_z_m[v, u] > 0)
        v, u = grid.reshape(2, -1)[:, measured]
        world = poses[row].apply(camera.unproject(depth_z_m.astype(float))[v, u])
        first = len(tracks)
        tracks += [[(row, float(a), float(b))] for a, b in zip(u, v, strict=True)]
        for other, (_, there) in witnesses:
            if other != row:
                for k, a, b in _seen(poses[other].inverse().apply(world), there, camera):
                    tracks[first + k].append((other, a, b))
        for (x, y, z), (r, g, b) in zip(world.tolist(), rgb[v, u].tolist(), strict=True):
            texts.append(f"{x:.6f} {y:.6f} {z:.6f} {r} {g} {b}")
    return texts, tracks


def _seen(
    points_camera: np.ndarray, depth_z_m: np.ndarray, camera: PinholeCamera
) -> Iterator[tuple[int, float, float]]:
    """Indices and pixels of the points (n, 3), given in a camera's frame, that are visible in its
    depth image.
    """
    pixels = np.nan_to_num(camera.project(points_camera), nan=-1.0).clip(-1, 1e6)
    places = np.rint(pixels).astype(int)
    inside = (points_camera[:, 2] > 0) & (places >= 0).all(1)
    inside &= (places[:, 0] < camera.width) & (places[:, 1] < camera.height)
    k = np.flatnonzero(inside)
    there = depth_z_m[places[k, 1], places[k, 0]]
    z = points_camera[k, 2]
    k = k[np.abs(there - z) < _SAME_SURFACE * z]
    yield from zip(k.tolist(), pixels[k, 0].tolist(), pixels[k, 1].tolist(), strict=True)


def _model(folder: Path) -> Path | None:
    models = [folder / name for name in _MODELS]
    return next((model for model in models if (model / "images.txt").is_file()), None)


def _found(folder: Path) -> bool:
    files = [folder / name / "images.txt" for name in _MODELS]
    return any(file.is_file() or file.with_suffix(".bin").is_file() for file in files)


def _rows(folder: Path) -> list[Row]:
    """The images of the model in the order of time, each with depth/NAME.png."""
    model = _model(folder)
    if model is None:
        hint = "COLMAP's model_converter, which makes text of a binary model"
        raise InputError("sparse/0/images.txt", path=folder, found="a binary model", hint=hint)
    found = []
    for stamp_s, name in colmap.stamps_and_names(model / "images.txt"):
        depth = folder / DEPTH / Path(name).with_suffix(".png")
        if not is_file(depth):
            expected = f"depth/{depth.name} in addition to COLMAP's images, which have no depth"
            raise InputError(expected, path=folder, found="none")
        found.append(Row(stamp_s, folder / "images" / name, depth))
    return found


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera of the model, which must have no distortion; the depth units are those of
    camera.json.
    """
    ours = camera_file(folder)
    model = _model(folder)
    if model is None or not (model / "cameras.txt").is_file():
        return ours
    file = model / "cameras.txt"
    lines = data_lines(read_text(file))
    if len(lines) != 1:
        raise InputError("one camera", path=file, found=len(lines))
    number, line = lines[0]
    _, kind, *values = [*line.split(), "", ""]
    known = {"PINHOLE": 6, "SIMPLE_PINHOLE": 5}
    if kind not in known:
        expected = f"a camera {' or '.join(known)}, without distortion"
        raise InputError(expected, path=file, line=number, found=kind)
    what = "WIDTH HEIGHT and the numbers of a " + kind
    w, h, *f, cx, cy = numbers_in(file, values[:-2], known[kind], what)
    pinhole = PinholeCamera(int(w), int(h), f[0], f[-1], cx - 0.5, cy - 0.5)
    if ours is None:
        return SequenceCamera(pinhole)
    return SequenceCamera(pinhole, ours.depth_units_per_metre)


def _truth(folder: Path) -> Path | None:
    model = _model(folder)
    return model / "images.txt" if model else None


FORMAT = SequenceFormat(
    "colmap",
    "COLMAP's text model for splatting programs: images/, sparse/0/ with points of the surface "
    "and a test split; depth/",
    lambda frame, kind: f"{_FOLDERS.get(kind, kind)}/{frame.number:06}.png",
    _write,
    Reader(_found, _rows, _camera, _truth),
    stamps="numbers",
    depth_stamps=False,
    every_pose=True,
)
