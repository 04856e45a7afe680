"""COLMAP's model for splatting programs: images/, sparse/0/ with cameras.txt, images.txt,
points3D.txt, and test.txt. Binary models are read too.

COLMAP has no depth: we add it in depth/ and camera.json. COLMAP's pixel centres are at +0.5, its
poses are world to camera, scalar first (https://colmap.github.io/format.html). test.txt lists every
8th image, the same that 3D Gaussian splatting holds out by default.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError, within
from ...formats.files import atomic_write_text, is_file, make_folder
from ...geometry.camera import PinholeCamera
from ...trajectory_files import colmap
from ...trajectory_files.colmap import MODELS, read_cameras
from ..camera_files import DISTORTED, SequenceCamera, camera_file
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat
from ..frames import Row
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
#: Every 8th image is held out, as in Mip-NeRF 360 and 3D Gaussian Splatting (`llffhold`).
HELD_OUT = 8


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    model = folder / _MODELS[0]
    c = contents.camera
    make_folder(model)
    listed.write_camera(folder, contents)
    camera = f"1 PINHOLE {c.width} {c.height} {c.fx!r} {c.fy!r} {c.cx + 0.5!r} {c.cy + 0.5!r}\n"
    atomic_write_text(model / "cameras.txt", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + camera)
    names = [Path(path).name for path in format.images(contents, RGB).paths]
    points, tracks = surface_points(contents)
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
    held_out = [f"{name}\n" for name in sorted(names)[::HELD_OUT]]
    atomic_write_text(model / "test.txt", "".join(held_out))


#: The track of a point: the row of an image and the pixel (u, v) where it is seen, centres at whole
#: numbers.
_Track = list[tuple[int, float, float]]


def surface_points(contents: Contents) -> tuple[list[str], list[_Track]]:
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


def _images(folder: Path) -> Path | None:
    """The file with the images of the model."""
    models = [folder / model for model in _MODELS]
    files = [model / "images.txt" for model in models]
    files += [model / "images.bin" for model in models]
    return next((file for file in files if is_file(file)), None)


def _rows(folder: Path) -> list[Row]:
    """The images of the model in the order of time, each with depth/NAME.png."""
    images = _images(folder)
    if images is None:
        raise InputError("sparse/0/images.txt", path=folder, found="none")
    rows = []
    for stamp_s, name in colmap.stamps_and_names(images):
        depth = folder / DEPTH / Path(name).with_suffix(".png")
        rows.append(Row(stamp_s, folder / "images" / name, depth))
    return rows


def _camera(folder: Path, image: Path) -> SequenceCamera | None:
    """The camera of the model; the depth units are those of camera.json."""
    ours = camera_file(folder)
    images = _images(folder)
    if images is None or not is_file(images.with_stem("cameras")):
        return ours
    file = images.with_stem("cameras")
    known = read_cameras(file)
    used = colmap.camera_numbers(images)
    if missing := sorted(used.difference(known)):
        expected = f"the cameras of {images.name}"
        raise InputError(expected, path=file, found=f"no camera {missing[0]}")
    cameras = {known[number] for number in used}
    if len(cameras) != 1:
        expected = "one camera, the same for all images"
        raise InputError(expected, path=file, found=f"{len(cameras)} different cameras")
    (camera,) = cameras
    if not camera.model.is_pinhole:
        pinholes = ", ".join(model.name for model in MODELS if model.is_pinhole)
        expected = f"a camera model that is a pinhole without distortion ({pinholes})"
        raise InputError(expected, path=file, found=camera.model.name)
    f = camera.focal_lengths
    cx, cy = camera.centre
    with within(file):
        pinhole = PinholeCamera(camera.width, camera.height, f[0], f[-1], cx - 0.5, cy - 0.5)
    found = replace(ours or SequenceCamera(pinhole), pinhole=pinhole)
    return replace(found, notes=(DISTORTED,)) if any(camera.coefficients) else found


FORMAT = SequenceFormat(
    "colmap",
    "COLMAP's text model for splatting programs: images/, sparse/0/ with points of the surface "
    "and a test split; depth/",
    lambda frame, kind: f"{_FOLDERS.get(kind, kind)}/{frame.number:06}.png",
    _write,
    Reader(lambda folder: _images(folder) is not None, _rows, _camera, _images),
    FormatLimits("numbers", depth_stamps=False, every_pose=True),
)
