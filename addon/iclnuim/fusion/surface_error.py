"""How far a reconstructed surface lies from the true one, vertex by vertex (paper, VI-A and Tables II, VII); both from files."""

import os
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from pathlib import Path

import numpy as np

from ..errors import InputError, WorkError, blender_missing, named
from ..evaluation.absolute_error import ErrorStatistics
from ..evaluation.align import MIN_EXTENT_SHARE, AlignmentSettings, align, principal_extents, umeyama
from ..evaluation.associate import associate
from ..formats.files import read_text
from ..formats.ply import read_ply
from ..geometry.scene_axes import UNITS_M, unit_name
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..raycast.caster import RayCaster
from ..raycast.distance import TriangleDistance
from .samples import areas_m2

GLTF_ENDINGS = (".gltf", ".glb")
MESH_ENDINGS = (".ply", ".obj", ".stl", ".off", *GLTF_ENDINGS)
#: Shares of the vertices within these distances are reported.
WITHIN_M = (0.001, 0.005, 0.01, 0.05)
#: Units, in metres, in which reconstructions arrive by mistake -> what the unit is called where one is set.
OTHER_UNITS_M = {unit_m: name for name, unit_m in UNITS_M.items() if name != "m"} | {0.1: "0.1", 1000.0: "1000"}
#: Below this share of the model's size a mean distance raises no question.
_UNSUSPICIOUS = 0.002
#: A reconstruction in metres is this large beside its model: a part of it, or all of it with some outliers.
_MIN_RATIO, _MAX_RATIO = 0.04, 1.6
#: A reflection has to bring the mean distance below this share of the best rigid fit's, and of the model's size, to be named.
_FAR_BETTER, _FITS = 0.25, 0.01
#: Above this share of the model's size, and still above _UNSUSPICIOUS after a fit from where it lies, it lies in another world frame.
_FAR_OFF = 0.03
#: (24, 3, 3): the rotations that take axes to axes.
_TURNS = np.array(
    [m for p in permutations(np.eye(3)) for s in product((1, -1), repeat=3) if np.linalg.det(m := s * np.array(p)) > 0]
)
#: Vertices that the checks look at.
_SAMPLE = 5000


@dataclass(frozen=True, eq=False)
class SurfaceError:
    """distances_m (n,): of each vertex to the nearest triangle of the model, after T_model_mesh. warnings: sentences, settings as `{name}`."""

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
    """What reconstructions are compared with: points (n, 3) in metres and triangles (m, 3).

    Raises InputError for no triangles, WorkError where libigl is missing.
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray) -> None:
        self._to, self._corners = TriangleDistance(points, triangles), points[np.unique(triangles)]

    @property
    def vertices(self) -> np.ndarray:
        """(n, 3) in metres."""
        return self._to.vertices

    @property
    def triangles(self) -> np.ndarray:
        """(m, 3) int64."""
        return self._to.triangles

    @cached_property
    def caster(self) -> RayCaster:
        """Rays at it. Raises WorkError where embreex is missing."""
        return RayCaster(self.vertices, self.triangles)

    def distance(self, points_m: np.ndarray) -> np.ndarray:
        """(n,) metres from points (n, 3) in its world to the nearest triangle."""
        return self._to.distance(points_m)

    def error(self, points: np.ndarray, T_model_mesh: SE3 | None = None) -> SurfaceError:
        """Of a reconstruction's vertices (n, 3) in metres, with warnings where its unit or handedness seems to be another."""
        T = SE3.identity() if T_model_mesh is None else T_model_mesh
        distances_m = self.distance(T.apply(points))
        return SurfaceError(distances_m, T, self._warnings(points, T, float(distances_m.mean())))

    def aligned(self, points: np.ndarray, T_model_mesh: SE3, rounds: int = 30) -> SE3:
        """T_model_mesh after point-to-plane ICP on 50 000 vertices; those within three medians (at least 0.5 mm) count.

        Raises InputError where the surfaces do not determine a motion.
        """
        T, some = T_model_mesh, points[:: max(1, len(points) // 50_000)]
        for _ in range(rounds):
            moved = T.apply(some)
            near = self._to.nearest(moved)
            normals, distance_m = self._to.normals(near.triangle), near.distance_m
            away_m = ((moved - near.point_m) * normals).sum(axis=1)
            use = distance_m <= max(5e-4, 3 * np.median(distance_m))
            J = np.hstack([normals[use], np.cross(moved[use], normals[use])])
            A = J.T @ J
            if len(J) < 6 or np.linalg.cond(A) > 1e10:
                found = f"{len(J)} vertices on planes that leave it undetermined"
                raise InputError("surfaces that determine a motion", found=found, hint="no alignment")
            step = np.linalg.solve(A, -J.T @ away_m[use])  # one Gauss-Newton step, a twist (6,) applied from the left
            T = SE3.exp(step) @ T
            if np.abs(step).max() < 1e-7:
                break
        return T

    def _mean_m(self, moved: np.ndarray) -> float:
        return float(self.distance(moved).mean())

    def _warnings(self, points: np.ndarray, T: SE3, mean_m: float) -> tuple[str, ...]:
        low, high = _reach(self._corners)
        size_m = float(np.linalg.norm(high - low))
        if mean_m <= _UNSUSPICIOUS * size_m:
            return ()
        some = points[:: max(1, len(points) // _SAMPLE)]
        if found := self._unit_warning(some, T, size_m):
            return (found,)
        moved = T.apply(some)
        fitted_m = self._fitted_mean_m(moved)
        found = self._mirror_warning(moved, fitted_m, (low + high) / 2, size_m)
        if not found and mean_m > _FAR_OFF * size_m and fitted_m > _UNSUSPICIOUS * size_m:
            found = (
                f"the mean distance is {mean_m / size_m:.1%} of the model's size: the reconstruction seems to lie in another "
                "world frame; give the trajectory that it was fused along as {poses}, and its ground truth as {truth}"
            )
        return (found,) if found else ()

    def _unit_warning(self, points: np.ndarray, T: SE3, size_m: float) -> str:
        """Its size cannot be that of the model or of a part of it in metres: the unit in which it fits, or is as large."""
        ratio = float(np.linalg.norm(np.subtract(*_reach(points)))) / size_m
        if _MIN_RATIO < ratio < _MAX_RATIO:
            return ""
        given_m = self._mean_m(T.apply(points))
        possible = [unit_m for unit_m in OTHER_UNITS_M if _MIN_RATIO < ratio * unit_m < _MAX_RATIO]
        means_m = {unit_m: self._mean_m(T.apply(points * unit_m)) for unit_m in possible}
        best = min(possible, key=means_m.__getitem__, default=1.0)
        if best in means_m and means_m[best] < 0.05 * size_m:
            better = f"its mean distance is then {1e3 * means_m[best]:.3g} mm instead of {1e3 * given_m:.3g} mm"
            name = unit_name(best)
            return f"the reconstruction seems to be in {name}, not in metres: {better}; set its unit to {OTHER_UNITS_M[best]}"
        alike = [OTHER_UNITS_M[unit_m] for unit_m in possible if ratio * unit_m > 0.5]
        advice = f"set its unit to {alike[0]}" if alike else "check its unit"
        return f"the reconstruction is {ratio:.3g} times as large as the model, which is in metres; {advice}"

    def _mirror_warning(self, moved: np.ndarray, fitted_m: float, centre: np.ndarray, size_m: float) -> str:
        """A reflection, about the model's centre or its origin, and then fitted, lies far nearer than the best rigid fit."""
        flipped = {(axis, about): moved.copy() for axis in range(3) for about in (0.0, 1.0)}
        for (axis, about), points in flipped.items():
            points[:, axis] = 2 * about * centre[axis] - points[:, axis]
        best = sorted(flipped, key=lambda which: self._mean_m(flipped[which]))[:2]
        mean_m, name = min((self._fitted_mean_m(flipped[which]), "xyz"[which[0]]) for which in best)
        if mean_m >= min(_FAR_BETTER * fitted_m, _FITS * size_m):
            return ""
        rigid_m = min(fitted_m, *(self._fitted_mean_m(moved @ R.T + t) for R, t in self._rigid_starts(moved)))
        if mean_m >= _FAR_BETTER * rigid_m:
            return ""
        return (
            f"the reconstruction is mirrored: with {name} flipped its mean distance is {1e3 * mean_m:.3g} mm instead of "
            f"{1e3 * rigid_m:.3g} mm; flip {name} of its vertices, or check the handedness of the poses it was made with"
        )

    def _rigid_starts(self, moved: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The ten best (R, t) of those that turn axes to axes, and lay a side or the middle of the box on the model's, on each axis."""
        some, target, starts = moved[::10], _reach(self._corners), []
        for R in _TURNS:
            own = _reach(some @ R.T)
            for shares in product((0.0, 0.5, 1.0), repeat=3):
                t = (1 - np.array(shares)) * (target[0] - own[0]) + shares * (target[1] - own[1])
                starts.append((self._mean_m(some @ R.T + t), R, t))
        return [(R, t) for _, R, t in sorted(starts, key=lambda start: start[0])[:10]]

    def _fitted_mean_m(self, moved: np.ndarray) -> float:
        """Mean distance as it lies or after ICP, whichever is less."""
        mean_m = self._mean_m(moved)
        try:
            return min(mean_m, self._mean_m(self.aligned(moved, SE3.identity()).apply(moved)))
        except InputError:
            return mean_m


def first_poses_transform(poses: Trajectory, truth: Trajectory, max_difference_s: float = 0.02) -> SE3:
    """T_model_mesh of a mesh fused along `poses`: lays the first of them on the pose of `truth` at its time.

    Raises InputError where the truth has no pose within max_difference_s.
    """
    start_s = poses.stamps_s[0]
    nearest = int(np.abs(truth.stamps_s - start_s).argmin())
    if abs(truth.stamps_s[nearest] - start_s) > max_difference_s:
        raise InputError(f"a pose at {start_s:.3f} s", found=f"{truth.stamps_s[nearest]:.3f} s at best")
    return truth.T_world_camera[nearest] @ poses.T_world_camera[0].inverse()


def trajectories_transform(poses: Trajectory, truth: Trajectory, method: str = "se3") -> SE3:
    """T_model_mesh of a mesh fused along `poses`, by aligning all of them with `truth` (`evaluation.align.METHODS`).

    Raises InputError where no stamps agree, or the trajectories do not determine it.
    """
    pairs = associate(truth.stamps_s, poses.stamps_s)
    reference, estimate = truth.T_world_camera[pairs.first], poses.T_world_camera[pairs.second]
    return align(reference, estimate, AlignmentSettings(method)).T_reference_estimate


def pairs_transform(mesh_points: np.ndarray, model_points: np.ndarray) -> tuple[SE3, float]:
    """T_model_mesh by points (n, 3) picked on the mesh and on the model, both in metres, and the RMS distance in metres that it leaves.

    Raises InputError for fewer than three pairs, or pairs on a line.
    """
    for picked in (mesh_points, model_points):
        if len(picked) < 3 or not principal_extents(picked)[1] > MIN_EXTENT_SHARE * principal_extents(picked)[0]:
            found = f"{len(picked)} that leave a rotation open"
            raise InputError("three or more pairs of points that are not on a line", found=found)
    T, _ = umeyama(mesh_points, model_points)
    left_m = np.linalg.norm(T.apply(mesh_points) - model_points, axis=1)
    return T, float(np.sqrt((left_m**2).mean()))


def _reach(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3,) and (3,): the box of nearly all points."""
    low, high = np.percentile(points, (1, 99), axis=0)
    return low, high


# -- surfaces from files


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """points (n, 3) in metres, triangles (m, 3), m = 0 for a cloud; notes: what was left out of the file, as sentences."""

    points: np.ndarray
    triangles: np.ndarray
    notes: tuple[str, ...] = ()


def read_reconstruction(path: Path | str, unit_m: float = 1.0) -> Reconstruction:
    """Of a mesh or a point cloud in units of unit_m. Points that are not finite are left out, with the triangles that have one.

    Raises InputError for a file that is neither or has no finite point, WorkError where a reader is missing.
    """
    points, triangles, _ = _read(Path(path))
    finite = np.isfinite(points).all(axis=1)
    bad, notes = int((~finite).sum()), []
    if bad == len(points):
        raise InputError("points of finite coordinates", path=path, found=f"NaN or infinity in {bad} of {bad}")
    if bad:
        whole = finite[triangles].all(axis=1)
        number = np.cumsum(finite) - 1
        notes.append(
            f"{bad} of {len(points)} points with NaN or infinity are left out, and {int((~whole).sum())} triangles"
        )
        points, triangles = points[finite], number[triangles[whole]]
    if not len(triangles):
        notes.append("without faces: a point cloud")
    elif not any(areas_m2(points, part).any() for part in np.array_split(triangles, len(triangles) // 1_000_000 + 1)):
        notes.append(f"none of {len(triangles)} triangles has an area: taken as a point cloud")
        triangles = triangles[:0]
    return Reconstruction(points if unit_m == 1 else points * unit_m, triangles, tuple(notes))


def read_mesh(path: Path | str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3), colours (n, 3) uint8 or (n, 0); polygons become triangles.

    Raises InputError for a file that is no mesh, is empty, has no triangle, or has coordinates that are not finite, WorkError where a reader is missing.
    """
    points, triangles, colours = _read(Path(path))
    bad = int((~np.isfinite(points).all(axis=1)).sum())
    if bad:
        found = f"NaN or infinity in {bad} of {len(points)}"
        raise InputError("points of finite coordinates", path=path, found=found, hint="removing them")
    if not len(triangles):
        raise InputError("a mesh with triangles", path=path, found=f"{len(points)} points and no triangle")
    return points, triangles, colours


def _read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if path.suffix.lower() not in MESH_ENDINGS:
        raise InputError(f"a mesh ({', '.join(MESH_ENDINGS)})", path=path, found=path.suffix or "no ending")
    if not path.is_file():
        raise InputError("a mesh", path=path, found="no such file")
    if path.suffix.lower() == ".ply":
        model = read_ply(path)
        points, triangles, colours = model.points, model.triangles, model.colours
    else:
        points, triangles = _read_gltf(path) if path.suffix.lower() in GLTF_ENDINGS else _read_plain(path)
        colours = np.zeros((len(points), 0), np.uint8)
    if not len(points):
        raise InputError("a mesh or a point cloud with points", path=path, found="none")
    return points, triangles, colours


def _read_plain(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import igl
    except ImportError:
        raise WorkError(f"{path}: {path.suffix} is read by libigl; try: pip install libigl, or a .ply") from None
    from ..blender import output

    try:
        with output.blender_output_in(Path(os.devnull)):
            points, triangles = igl.read_triangle_mesh(str(path))
    except RuntimeError as error:
        raise InputError("a whole mesh", path=path, found=str(error).splitlines()[0]) from None
    return points, triangles.reshape(-1, 3).astype(np.int64)


def _read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import open3d
    except ImportError:
        raise WorkError(f"{path}: {path.suffix} is read by open3d; try: pip install open3d-cpu, or a .ply") from None
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).reshape(-1, 3).astype(np.int64)


def read_model(name: str) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3) and triangles (m, 3) of a mesh file, a built-in scene by name, or a .blend; in its own world, z up for scenes.

    Raises InputError for what is none of them or has no triangle, WorkError where a reader or bpy is missing.
    """
    if Path(name).suffix.lower() in MESH_ENDINGS:
        points, triangles, _ = read_mesh(Path(name))
        return points, triangles
    from ..blender import output

    with output.blender_output_in(Path(os.devnull)):  # the very import of bpy may print
        try:
            from ..blender import scene, surfaces
        except ImportError as error:
            raise blender_missing("a scene as the model", error) from None
        scene.open_scene(name)
        found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found=name)
    return found.vertices, found.triangles


def read_transform(path: Path) -> SE3:
    """The rigid motion of a text file with the 16 numbers of a 4 x 4 matrix, row by row. Raises InputError."""
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
    return SE3(T[:3, :3], T[:3, 3])


def read_pairs(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) on the mesh and (n, 3) on the model of a text file with six numbers a line; `#` begins a comment. Raises InputError."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = [np.nan]
        if row and (len(row) != 6 or not np.isfinite(row).all()):
            raise InputError("six numbers: x y z on the mesh, x y z on the model", path=path, line=number, found=line)
        rows += [row] if row else []
    picked = np.array(rows).reshape(-1, 6)
    return picked[:, :3], picked[:, 3:]
