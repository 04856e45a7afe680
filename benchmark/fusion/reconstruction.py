"""Reads a reconstruction, and what places it in the model's world."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError, within
from iclnuim.formats.files import data_lines, read_text
from iclnuim.formats.meshes import read_mesh_or_cloud
from iclnuim.formats.ply import MeshLabels, read_ply_labels
from iclnuim.geometry.se3 import SE3
from iclnuim.trajectory_files.reader import LARGEST_POSITION_M

from .samples import areas_m2


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """points (n, 3) in metres, triangles (m, 3), m = 0 for a cloud; notes: sentences about parts of
    the file that are not used; labels: of the triangles or of the points, if they were requested.
    """

    points: np.ndarray
    triangles: np.ndarray
    notes: tuple[str, ...] = ()
    labels: MeshLabels | None = None


def read_reconstruction(
    path: Path | str, unit_m: float = 1.0, labelled: bool = False
) -> Reconstruction:
    """Read a mesh or a point cloud in units of unit_m, and its labels if requested. Points that are
    not finite, and triangles with such points, are left out.

    Raises InputError for a file that is neither, has no finite point or points too far away, and
    for an invalid unit, WorkError if a reader is missing.
    """
    if not 1e-6 <= unit_m <= 1e6:
        raise InputError("1e-06 to 1e+06 m", setting="unit", found=unit_m)
    points, triangles, _ = read_mesh_or_cloud(Path(path))
    labels = _labels(Path(path)) if labelled else None
    notes = []
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        if labels is not None:
            rows = finite[triangles].all(axis=1) if labels.of_triangles else finite
            labels = replace(labels, values=labels.values[rows])
        points, triangles, note = _finite_part(path, points, triangles, finite)
        notes.append(note)
    points, triangles, labels, unused = _used_part(points, triangles, labels)
    if unused:
        notes.append(f"{unused} vertices that no face uses are left out")
    if unit_m != 1:
        points = points * unit_m
    with within(path):
        check_positions(points, "another {unit}, or moving the mesh near the origin")
    if not len(triangles):
        notes.append("without faces: a point cloud")
    elif not areas_m2(points, triangles).any():
        notes.append(f"none of {len(triangles)} triangles has an area: read as a point cloud")
        triangles = triangles[:0]
    if labels is not None and labels.of_triangles and not len(triangles):
        raise InputError("labels of faces with an area", path=path, found="none")
    return Reconstruction(points, triangles, tuple(notes), labels)


def _labels(path: Path) -> MeshLabels:
    """The labels of a PLY. Raises InputError for another mesh."""
    if path.suffix.lower() != ".ply":
        expected = "labels as a property of the faces or vertices of a .ply"
        raise InputError(expected, path=path, found=path.suffix)
    return read_ply_labels(path)


def _used_part(
    points: np.ndarray, triangles: np.ndarray, labels: MeshLabels | None
) -> tuple[np.ndarray, np.ndarray, MeshLabels | None, int]:
    """The points that triangles use, all of a cloud or where no triangle has an area, and the number
    of the others.
    """
    used = np.zeros(len(points), bool)
    used[triangles] = True
    if used.all() or not (areas_m2(points, triangles) > 0).any():
        return points, triangles, labels, 0
    if labels is not None and not labels.of_triangles:
        labels = replace(labels, values=labels.values[used])
    number = np.cumsum(used) - 1
    return points[used], number[triangles], labels, int((~used).sum())


def _finite_part(
    path: Path | str, points: np.ndarray, triangles: np.ndarray, finite: np.ndarray
) -> tuple[np.ndarray, np.ndarray, str]:
    """The finite points, the triangles of finite points, and a note about the others."""
    total = len(points)
    invalid = total - int(finite.sum())
    if invalid == total:
        found = f"NaN or infinity in {total} of {total}"
        raise InputError("points of finite coordinates", path=path, found=found)
    whole = finite[triangles].all(axis=1)
    number = np.cumsum(finite) - 1
    note = (
        f"{invalid} of {total} points with NaN or infinity are left out, "
        f"and {int((~whole).sum())} triangles"
    )
    return points[finite], number[triangles[whole]], note


def check_positions(points: np.ndarray, hint: str | None = None) -> None:
    """Raises InputError for points (n, 3) in metres that are farther from the origin than poses can
    be.
    """
    largest_m = np.abs(points).max()
    if largest_m > LARGEST_POSITION_M:
        raise InputError(
            f"coordinates of at most {LARGEST_POSITION_M:g} m", found=f"{largest_m:g} m", hint=hint
        )


def read_transform(path: Path) -> SE3:
    """Read a rigid motion from a text file with the 16 numbers of a 4 x 4 matrix, row by row.

    Raises InputError.
    """
    try:
        T = np.array([float(word) for word in read_text(path).replace(",", " ").split()])
    except ValueError as error:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=error) from None
    if T.size != 16:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=f"{T.size} numbers")
    T = T.reshape(4, 4)
    rigid = np.isfinite(T).all() and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3)
    if not rigid or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise InputError("a rigid motion, last row 0 0 0 1", path=path)
    if np.linalg.det(T[:3, :3]) < 0:
        found = "a reflection (determinant -1)"
        raise InputError("a rotation and a translation", path=path, found=found)
    return SE3(T[:3, :3], T[:3, 3])


def read_pairs(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read points (n, 3) on the mesh and (n, 3) on the model from a text file with six numbers per
    line; `#` begins a comment. Raises InputError.
    """
    rows = []
    for number, line in data_lines(read_text(path)):
        words = line.replace(",", " ").replace(";", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = [np.nan]
        if not row:
            continue
        if len(row) != 6 or not np.isfinite(row).all():
            expected = "six numbers: x y z on the mesh, x y z on the model"
            raise InputError(expected, path=path, line=number, found=line)
        rows.append(row)
    picked = np.array(rows).reshape(-1, 6)
    return picked[:, :3], picked[:, 3:]
