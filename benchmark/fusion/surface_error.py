"""Distance of each vertex of a reconstructed surface to the true one (paper, VI-A and Tables II,
VII), and readers for both.
"""

import os
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError, WorkError, blender_missing, named, within
from iclnuim.evaluation.absolute_error import ErrorStatistics
from iclnuim.evaluation.align import (
    MIN_EXTENT_SHARE,
    AlignmentSettings,
    align,
    principal_extents,
    umeyama,
)
from iclnuim.evaluation.associate import associate
from iclnuim.formats.files import data_lines, read_text
from iclnuim.formats.ply import read_ply
from iclnuim.formats.trajectory_reader import LARGEST_POSITION_M
from iclnuim.geometry.scene_axes import UNITS_M, unit_name
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.distance import TriangleDistance

from .samples import areas_m2

GLTF_ENDINGS = (".gltf", ".glb")
MESH_ENDINGS = (".ply", ".obj", ".stl", ".off", *GLTF_ENDINGS)
#: Distances for which the share of the vertices within is reported.
WITHIN_M = (0.001, 0.005, 0.01, 0.05)
#: Units, in metres, that reconstructions have by mistake.
OTHER_UNITS_M = (*(unit_m for name, unit_m in UNITS_M.items() if name != "m"), 1000.0)
#: Smallest and largest unit of a reconstruction.
_UNITS_M = (1e-6, 1e6)
#: A mean distance below this share of the model's size is not checked further.
_SMALL_MEAN = 0.002
#: Valid size ratio of a reconstruction in metres to its model: from a part of it to all of it with
#: some outliers.
_MIN_RATIO, _MAX_RATIO = 0.04, 1.6
#: A reconstruction is reported as mirrored if a reflection has a mean distance below _MIRROR_RATIO
#: of the best rigid fit's and below _MIRROR_FIT of the model's size.
_MIRROR_RATIO, _MIRROR_FIT = 0.25, 0.01
#: With a mean distance above this share of the model's size, and above _SMALL_MEAN after ICP from
#: the given pose, the reconstruction is reported to be in another world frame.
_OTHER_WORLD = 0.03
#: (24, 3, 3): the rotations that map axes to axes.
_AXIS_ROTATIONS = np.array(
    [
        m
        for p in permutations(np.eye(3))
        for s in product((1, -1), repeat=3)
        if np.linalg.det(m := s * np.array(p)) > 0
    ]
)
#: Number of vertices that the checks use.
_SAMPLE = 5000


def _unit(unit_m: float) -> tuple[str, str]:
    """The name of a unit in metres, and the value of the unit setting for it."""
    for setting, known_m in UNITS_M.items():
        if np.isclose(known_m, unit_m, rtol=1e-9):
            return unit_name(known_m), setting
    return unit_name(unit_m), f"{unit_m:g}"


@dataclass(frozen=True, eq=False)
class SurfaceError:
    """distances_m (n,): from each vertex, after T_model_mesh, to the nearest triangle of the model.
    warnings: sentences with settings as `{name}`.
    """

    distances_m: np.ndarray
    T_model_mesh: SE3
    warnings: tuple[str, ...] = ()

    @property
    def statistics(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.distances_m)

    def to_dict(self) -> dict:
        within = {f"{1e3 * d:g}mm": float((self.distances_m <= d).mean()) for d in WITHIN_M}
        return {
            "vertices": len(self.distances_m),
            "distance_m": self.statistics.to_dict(),
            "within": within,
            "T_model_mesh": self.T_model_mesh.matrix.tolist(),
            "warnings": [named(text) for text in self.warnings],
        }


class TrueSurface:
    """The true surface for comparison with reconstructions: points (n, 3) in metres and triangles
    (m, 3).

    Raises InputError if there are no triangles, or if they are in one place or too far away,
    WorkError if libigl is missing.
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray) -> None:
        self._distance = TriangleDistance(points, triangles)
        self._corners = self._distance.vertices[np.unique(triangles)]
        _check_positions(self._corners)
        if (self._corners == self._corners[0]).all():
            raise InputError("a surface with an area", found="all vertices in one place")

    @property
    def vertices(self) -> np.ndarray:
        """(n, 3) in metres."""
        return self._distance.vertices

    @property
    def triangles(self) -> np.ndarray:
        """(m, 3) int64."""
        return self._distance.triangles

    @cached_property
    def caster(self) -> RayCaster:
        """A ray caster of this surface. Raises WorkError if embreex is missing."""
        return RayCaster(self.vertices, self.triangles)

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) distances in metres from points (n, 3) in the model's world to the nearest triangle."""
        return self._distance.distance(points_m)

    def error(
        self, points: np.ndarray, T_model_mesh: SE3 | None = None, unit_m: float = 1.0
    ) -> SurfaceError:
        """Error of a reconstruction's vertices (n, 3) in metres, with warnings if its unit,
        handedness or world frame seems to be wrong.
        `unit_m`: the unit from which they were converted to metres, for these warnings.

        Raises InputError for another shape, if there are no vertices, or if some are NaN, infinite
        or too far away.
        """
        points = np.asarray(points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError("vertices (n, 3)", found=points.shape)
        if not len(points) or not np.isfinite(points).all():
            found = (
                f"{np.count_nonzero(~np.isfinite(points).all(-1))} of {len(points)} that are not"
            )
            raise InputError("vertices (n, 3) that are finite", found=found)
        _check_positions(points)
        T = SE3.identity() if T_model_mesh is None else T_model_mesh
        distances_m = self.distance(T.apply(points))
        return SurfaceError(
            distances_m, T, self._warnings(points, T, float(distances_m.mean()), unit_m)
        )

    def aligned(self, points: np.ndarray, T_model_mesh: SE3, rounds: int = 30) -> SE3:
        """T_model_mesh after point-to-plane ICP on 50 000 vertices; inliers are within three
        medians (at least 0.5 mm).

        Raises InputError if the surfaces do not determine a rigid motion.
        """
        T, some = T_model_mesh, points[:: max(1, len(points) // 50_000)]
        for _ in range(rounds):
            moved = T.apply(some)
            near = self._distance.nearest(moved)
            normals, distance_m = self._distance.normals(near.triangle), near.distance_m
            offset_m = ((moved - near.point_m) * normals).sum(axis=1)
            use = distance_m <= max(5e-4, 3 * np.median(distance_m))
            J = np.hstack([normals[use], np.cross(moved[use], normals[use])])
            A = J.T @ J
            if len(J) < 6 or np.linalg.cond(A) > 1e10:
                found = f"{len(J)} vertices on planes for which it is undetermined"
                raise InputError(
                    "surfaces that determine a motion", found=found, hint="no alignment"
                )
            step = np.linalg.solve(
                A, -J.T @ offset_m[use]
            )  # one Gauss-Newton step, a twist (6,) applied from the left
            T = SE3.exp(step) @ T
            if np.abs(step).max() < 1e-7:
                break
        return T

    def _mean_m(self, moved: np.ndarray) -> float:
        return float(self.distance(moved).mean())

    def _warnings(
        self, points: np.ndarray, T: SE3, mean_m: float, unit_m: float
    ) -> tuple[str, ...]:
        low, high = _extent(self._corners)
        size_m = float(np.linalg.norm(high - low))
        if not size_m or mean_m <= _SMALL_MEAN * size_m:  # 0: nearly all vertices are in one place
            return ()
        some = points[:: max(1, len(points) // _SAMPLE)]
        if found := self._unit_warning(some, T, size_m, unit_m):
            return (found,)
        moved = T.apply(some)
        fitted_m = self._fitted_mean_m(moved)
        found = self._mirror_warning(moved, fitted_m, (low + high) / 2, size_m)
        if not found and mean_m > _OTHER_WORLD * size_m and fitted_m > _SMALL_MEAN * size_m:
            found = (
                f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction seems to be in another "
                "world frame; set {poses} to the trajectory that was used for fusion, and {truth} to its ground truth"
            )
        return (found,) if found else ()

    def _unit_warning(self, points: np.ndarray, T: SE3, size_m: float, unit_m: float) -> str:
        """Warning if the size is not valid for the model or a part of it in metres, with the unit
        that fits or gives a similar size. `unit_m`: the
        unit that the points were in, as far as is known.
        """
        ratio = float(np.linalg.norm(np.subtract(*_extent(points)))) / size_m
        if _MIN_RATIO < ratio < _MAX_RATIO:
            return ""
        given_m = self._mean_m(T.apply(points))
        possible = [factor for factor in OTHER_UNITS_M if _MIN_RATIO < ratio * factor < _MAX_RATIO]
        means_m = {factor: self._mean_m(T.apply(points * factor)) for factor in possible}
        best = min(possible, key=means_m.__getitem__, default=1.0)
        if best in means_m and means_m[best] < 0.05 * size_m:
            better = f"its mean distance is then {1e3 * means_m[best]:.3g} mm instead of {1e3 * given_m:.3g} mm"
            name, setting = _unit(best * unit_m)
            return f"the reconstruction seems to be in {name}, not in {_unit(unit_m)[0]}: {better}; set its unit to {setting}"
        similar = [_unit(factor * unit_m)[1] for factor in possible if ratio * factor > 0.5]
        advice = f"set its unit to {similar[0]}" if similar else "check its unit"
        return f"the reconstruction is {ratio:.3g} times as large as the model, which is in metres; {advice}"

    def _mirror_warning(
        self, moved: np.ndarray, fitted_m: float, centre: np.ndarray, size_m: float
    ) -> str:
        """Warning if a reflection about the model's centre or origin, followed by ICP, is much
        closer than the best rigid fit.
        """
        flipped = {(axis, about): moved.copy() for axis in range(3) for about in (0.0, 1.0)}
        for (axis, about), points in flipped.items():
            points[:, axis] = 2 * about * centre[axis] - points[:, axis]
        best = sorted(flipped, key=lambda which: self._mean_m(flipped[which]))[:2]
        mean_m, name = min((self._fitted_mean_m(flipped[which]), "xyz"[which[0]]) for which in best)
        if mean_m >= min(_MIRROR_RATIO * fitted_m, _MIRROR_FIT * size_m):
            return ""
        rigid_m = min(
            fitted_m, *(self._fitted_mean_m(moved @ R.T + t) for R, t in self._rigid_starts(moved))
        )
        if mean_m >= _MIRROR_RATIO * rigid_m:
            return ""
        return (
            f"the reconstruction is mirrored: with {name} flipped its mean distance is {1e3 * mean_m:.3g} mm instead of "
            f"{1e3 * rigid_m:.3g} mm; flip {name} of its vertices, or check the handedness of the poses it was made with"
        )

    def _rigid_starts(self, moved: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The ten best (R, t) of those that map axes to axes and align, on each axis, one side or
        the centre of the box with the model's.
        """
        some, target, starts = moved[::10], _extent(self._corners), []
        for R in _AXIS_ROTATIONS:
            extent = _extent(some @ R.T)
            for shares in product((0.0, 0.5, 1.0), repeat=3):
                t = (1 - np.array(shares)) * (target[0] - extent[0]) + shares * (
                    target[1] - extent[1]
                )
                starts.append((self._mean_m(some @ R.T + t), R, t))
        return [(R, t) for _, R, t in sorted(starts, key=lambda start: start[0])[:10]]

    def _fitted_mean_m(self, moved: np.ndarray) -> float:
        """Mean distance as given or after ICP, whichever is less."""
        mean_m = self._mean_m(moved)
        try:
            return min(mean_m, self._mean_m(self.aligned(moved, SE3.identity()).apply(moved)))
        except InputError:
            return mean_m


def first_poses_transform(
    poses: Trajectory, truth: Trajectory, max_difference_s: float = 0.02
) -> SE3:
    """T_model_mesh of a mesh fused along `poses`: aligns the first of them with the pose of `truth`
    at its time.

    Raises InputError if the truth has no pose within max_difference_s.
    """
    start_s = poses.stamps_s[0]
    nearest = int(np.abs(truth.stamps_s - start_s).argmin())
    if abs(truth.stamps_s[nearest] - start_s) > max_difference_s:
        raise InputError(
            f"a pose at {start_s:.3f} s", found=f"the nearest at {truth.stamps_s[nearest]:.3f} s"
        )
    return truth.T_world_camera[nearest] @ poses.T_world_camera[0].inverse()


def trajectories_transform(poses: Trajectory, truth: Trajectory, method: str = "se3") -> SE3:
    """T_model_mesh of a mesh fused along `poses`, by aligning all of them with `truth`
    (`evaluation.align.METHODS`).

    Raises InputError if no stamps match, or the trajectories do not determine the alignment.
    """
    pairs = associate(truth.stamps_s, poses.stamps_s)
    reference, estimate = truth.T_world_camera[pairs.first], poses.T_world_camera[pairs.second]
    return align(reference, estimate, AlignmentSettings(method)).T_reference_estimate


def pairs_transform(mesh_points: np.ndarray, model_points: np.ndarray) -> tuple[SE3, float]:
    """T_model_mesh from points (n, 3) picked on the mesh and on the model, both in metres, and the
    remaining RMS distance in metres.

    Raises InputError for fewer than three pairs, or pairs on a line.
    """
    for picked in (mesh_points, model_points):
        if (
            len(picked) < 3
            or not principal_extents(picked)[1] > MIN_EXTENT_SHARE * principal_extents(picked)[0]
        ):
            found = f"{len(picked)} for which a rotation is undetermined"
            raise InputError("three or more pairs of points that are not on a line", found=found)
    T, _ = umeyama(mesh_points, model_points)
    residual_m = np.linalg.norm(T.apply(mesh_points) - model_points, axis=1)
    return T, float(np.sqrt((residual_m**2).mean()))


def _extent(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3,) and (3,): corners of the box of nearly all points (1st to 99th percentile)."""
    low, high = np.percentile(points, (1, 99), axis=0)
    return low, high


# -- surfaces from files


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """points (n, 3) in metres, triangles (m, 3), m = 0 for a cloud; notes: sentences about parts of
    the file that are not used.
    """

    points: np.ndarray
    triangles: np.ndarray
    notes: tuple[str, ...] = ()


def read_reconstruction(path: Path | str, unit_m: float = 1.0) -> Reconstruction:
    """Read a mesh or a point cloud in units of unit_m. Points that are not finite, and triangles
    with such points, are left out.

    Raises InputError for a file that is neither, has no finite point or points too far away, and
    for an invalid unit, WorkError if a reader is missing.
    """
    low, high = _UNITS_M
    if not low <= unit_m <= high:
        raise InputError(f"{low:g} to {high:g} m", setting="unit", found=unit_m)
    points, triangles, _ = _read(Path(path))
    finite = np.isfinite(points).all(axis=1)
    invalid, notes = int((~finite).sum()), []
    if invalid == len(points):
        raise InputError(
            "points of finite coordinates",
            path=path,
            found=f"NaN or infinity in {invalid} of {invalid}",
        )
    if invalid:
        whole = finite[triangles].all(axis=1)
        number = np.cumsum(finite) - 1
        notes.append(
            f"{invalid} of {len(points)} points with NaN or infinity are left out, and {int((~whole).sum())} triangles"
        )
        points, triangles = points[finite], number[triangles[whole]]
    points = points if unit_m == 1 else points * unit_m
    with within(path):
        _check_positions(points, "another {unit}, or moving the mesh near the origin")
    if not len(triangles):
        notes.append("without faces: a point cloud")
    elif not any(
        areas_m2(points, part).any()
        for part in np.array_split(triangles, len(triangles) // 1_000_000 + 1)
    ):
        notes.append(f"none of {len(triangles)} triangles has an area: read as a point cloud")
        triangles = triangles[:0]
    return Reconstruction(points, triangles, tuple(notes))


def _check_positions(points: np.ndarray, hint: str | None = None) -> None:
    """Raises InputError for points (n, 3) in metres that are farther from the origin than poses can
    be.
    """
    largest_m = np.abs(points).max()
    if largest_m > LARGEST_POSITION_M:
        raise InputError(
            f"coordinates of at most {LARGEST_POSITION_M:g} m", found=f"{largest_m:g} m", hint=hint
        )


def read_mesh(path: Path | str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3), colours (n, 3) uint8 or (n, 0); polygons become triangles.

    Raises InputError for a file that is not a mesh, is empty, has no triangle, or has coordinates
    that are not finite, WorkError if a reader is missing.
    """
    points, triangles, colours = _read(Path(path))
    invalid = int((~np.isfinite(points).all(axis=1)).sum())
    if invalid:
        found = f"NaN or infinity in {invalid} of {len(points)}"
        raise InputError(
            "points of finite coordinates", path=path, found=found, hint="removing them"
        )
    if not len(triangles):
        raise InputError(
            "a mesh with triangles", path=path, found=f"{len(points)} points and no triangle"
        )
    return points, triangles, colours


def _read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if path.suffix.lower() not in MESH_ENDINGS:
        raise InputError(
            f"a mesh ({', '.join(MESH_ENDINGS)})", path=path, found=path.suffix or "no ending"
        )
    if not path.is_file():
        raise InputError("a mesh", path=path, found="no such file")
    if path.suffix.lower() == ".ply":
        model = read_ply(path)
        points, triangles, colours = model.points, model.triangles, model.colours
    else:
        points, triangles = (
            _read_gltf(path) if path.suffix.lower() in GLTF_ENDINGS else _read_plain(path)
        )
        colours = np.zeros((len(points), 0), np.uint8)
    if not len(points):
        raise InputError("a mesh or a point cloud with points", path=path, found="none")
    return points, triangles, colours


def _read_plain(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import igl
    except ImportError:
        raise WorkError(
            f"{path}: {path.suffix} is read by libigl; try: pip install libigl, or a .ply"
        ) from None
    from iclnuim.blender import output

    try:
        with output.blender_output_in(Path(os.devnull)):
            points, triangles = igl.read_triangle_mesh(str(path))
    except RuntimeError as error:
        raise InputError(
            "a complete mesh", path=path, found=str(error).splitlines()[0], hint="a .ply"
        ) from None
    triangles = triangles.reshape(-1, 3).astype(np.int64)
    if (
        path.suffix.lower() == ".stl"
    ):  # each triangle has corners of its own: means over vertices would depend on the format
        points, merged = np.unique(points, axis=0, return_inverse=True)
        triangles = merged.reshape(-1)[triangles]
    return points, triangles


def _read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import open3d
    except ImportError:
        raise WorkError(
            f"{path}: {path.suffix} is read by open3d; try: pip install open3d-cpu, or a .ply"
        ) from None
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    if not len(mesh.vertices):
        raise InputError(
            "a glTF file from which Open3D reads a mesh", path=path, found="none", hint="a .ply"
        )
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).reshape(-1, 3).astype(np.int64)


def read_model(name: str) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) and triangles (m, 3) of a mesh file, a built-in scene by name, or a .blend; in
    the world of the file, z up for scenes.

    Raises InputError if it is none of these or has no triangle, WorkError if a reader or bpy is
    missing.
    """
    if Path(name).suffix.lower() in MESH_ENDINGS:
        points, triangles, _ = read_mesh(Path(name))
        return points, triangles
    from iclnuim.blender import output

    with output.blender_output_in(Path(os.devnull)):  # importing bpy may print
        try:
            from iclnuim.blender import surfaces
            from iclnuim.blender.open import scene
        except ImportError as error:
            raise blender_missing("a scene as the model", error) from None
        scene.open_scene(name)
        found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found=name)
    return found.vertices, found.triangles


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
        raise InputError(
            "a rotation and a translation", path=path, found="a reflection (determinant -1)"
        )
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
        if row and (len(row) != 6 or not np.isfinite(row).all()):
            raise InputError(
                "six numbers: x y z on the mesh, x y z on the model",
                path=path,
                line=number,
                found=line,
            )
        rows += [row] if row else []
    picked = np.array(rows).reshape(-1, 6)
    return picked[:, :3], picked[:, 3:]
