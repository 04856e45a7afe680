"""Distance of each vertex of a reconstructed surface to the true one (paper, VI-A and Tables II,
VII).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.errors import InputError, named
from iclnuim.evaluation.absolute_error import ErrorStatistics
from iclnuim.geometry.se3 import SE3, Poses
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.distance import TriangleDistance
from iclnuim.shown import MM, Shown, plot_shares

from .alignment import icp
from .mistakes import warnings
from .reconstruction import check_positions

if TYPE_CHECKING:
    from iclnuim.shown import Axes

#: Distances for which the share of the vertices within is reported.
WITHIN_M = (0.001, 0.005, 0.01, 0.05)


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceError(Shown):
    """distances_m (n,): from each vertex, after T_model_mesh, to the nearest triangle of the model.
    warnings: sentences with settings as `{name}`.
    """

    distances_m: np.ndarray
    T_model_mesh: SE3
    warnings: tuple[str, ...] = ()

    @property
    def statistics(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.distances_m)

    def summary(self) -> str:
        s = self.statistics
        words = f"mean {MM * s.mean:.4g} mm, median {MM * s.median:.4g} mm"
        return f"{words}, {len(self.distances_m)} vertices"

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the share of vertices within a distance; returns the Matplotlib axes."""
        return plot_shares(axes, self.distances_m, "vertices")

    def to_dict(self) -> dict[str, Any]:
        """Number of vertices, statistics of the distances in metres, the share within 1, 5, 10 and
        50 mm, the transform (4, 4) and the warnings.
        """
        within = {f"{1e3 * d:g}mm": float((self.distances_m <= d).mean()) for d in WITHIN_M}
        return {
            "vertices": len(self.distances_m),
            "distance_m": self.statistics.to_dict(),
            "within": within,
            "T_model_mesh": self.T_model_mesh.matrix.tolist(),
            "warnings": [named(text) for text in self.warnings],
        }


class TrueSurface(TriangleDistance):
    """The true surface for comparison with reconstructions: points (n, 3) in metres and triangles
    (m, 3).

    Raises InputError if there are no triangles, or if they are in one place or too far away,
    WorkError if libigl is missing.
    """

    def __init__(self, points: np.ndarray, triangles: np.ndarray) -> None:
        super().__init__(points, triangles)
        corners = self.vertices[np.unique(self.triangles)]
        check_positions(corners)
        if (corners == corners[0]).all():
            raise InputError("a surface with an area", found="all vertices in one place")

    @cached_property
    def caster(self) -> RayCaster:
        """A ray caster of this surface. Raises WorkError if embreex is missing."""
        return RayCaster(self.vertices, self.triangles)

    def error(
        self,
        points: np.ndarray,
        T_model_mesh: Poses | None = None,
        unit_m: float = 1.0,
        model_unit_m: float = 1.0,
    ) -> SurfaceError:
        """Error of a reconstruction's vertices (n, 3) in metres, with warnings if its unit,
        handedness or world frame seems to be wrong. `unit_m`, `model_unit_m`: the units from which
        they and the model were converted to metres, for these warnings.

        Raises InputError for another shape, if there are no vertices, or if some are NaN, infinite
        or too far away.
        """
        points = np.asarray(points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError("vertices (n, 3)", found=points.shape)
        finite = np.isfinite(points).all(-1)
        if not len(points) or not finite.all():
            found = f"{np.count_nonzero(~finite)} of {len(points)} that are not"
            raise InputError("vertices (n, 3) that are finite", found=found)
        check_positions(points)
        T = SE3.identity() if T_model_mesh is None else SE3.of(T_model_mesh)
        distances_m = self.distance(T.apply(points))
        advice = warnings(self, points, T, float(distances_m.mean()), (unit_m, model_unit_m))
        return SurfaceError(distances_m, T, advice)

    def aligned(self, points: np.ndarray, T_model_mesh: SE3) -> SE3:
        """T_model_mesh after point-to-plane ICP of points (n, 3) in metres. Raises InputError if
        the surfaces do not determine a rigid motion.
        """
        return icp(self, points, T_model_mesh)
