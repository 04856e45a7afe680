"""The texels of a light map as points of the scene, and the light on them."""

import functools
from collections.abc import Callable

import bpy
import numpy as np

from ...lightmap.denoise import contrast, denoise, fill, grown, next_to_known
from ...lightmap.layout import Layout
from . import light_sampling

#: Hidden texels get the samples divided by this, for all lamps together: they are not shown, and a
#: gathered ray averages over many of them.
_HIDDEN_SHARE = 4
#: Places on the line from a hidden texel to a visible one, where its point may move to.
_STEPS_INTO_VIEW = (0.2, 0.4, 0.6, 0.8, 1.0)
#: A dark texel is hidden without further tests if its chart has at least this number of texels, and
#: none of them within this number of steps was found visible by the first tests.
_LARGE_CHART = 64
_NEAR_STEPS = 4
#: Texels around those with light that get the light of their neighbours: bilinear filtering reads
#: one, and one more is spare.
_GUTTER = 2


def seen_texels(layout: Layout, places: np.ndarray, seed: int) -> np.ndarray:
    """(N,) light of lamps at the cameras' places on each texel, see light_sampling.seen."""
    texels = layout.texels
    chart = texels.image(texels.chart, -1)
    large = np.bincount(texels.chart)[texels.chart] >= _LARGE_CHART

    def hidden(found: np.ndarray) -> np.ndarray:
        near = grown(texels.image(found, False), chart, _NEAR_STEPS)
        return large & ~near.ravel()[texels.index]

    return light_sampling.seen(*layout.points(), places, seed, hidden)


class MapPoints:
    """The texels of a map: their points, whether they are visible, and the light on them.

    seen (N,): whether a texel is visible from the places; translucent (F,): faces that let light
    through.
    """

    def __init__(
        self,
        layout: Layout,
        seen: np.ndarray,
        places: np.ndarray,
        samples: int,
        seed: int,
        translucent: np.ndarray,
    ) -> None:
        self.layout = layout
        self.samples = samples
        self.seed = seed
        self.points_m, self.normals = layout.points()
        image = layout.texels.image
        self.chart = image(layout.texels.chart, -1)
        self.facing = image(self.normals.astype(np.float32))
        # visible texels, and texels whose light passes through to a visible side
        seen = seen.copy()
        rows = np.flatnonzero(translucent[layout.face_of_texel] & ~seen)
        seen[rows] = light_sampling.seen(self.points_m[rows], -self.normals[rows], places, seed) > 0
        self.visible = image(seen, False)
        self._into_view(places)

    def _into_view(self, places: np.ndarray) -> None:
        """Move the point of each hidden texel next to a visible one to the first visible point on
        the line to that texel.

        So the light close to a contact of two surfaces is sampled there, and not at a texel farther
        away.
        """
        hidden, near = next_to_known(self.visible, self.chart)
        hidden_row = np.searchsorted(self.layout.texels.index, hidden)
        near_row = np.searchsorted(self.layout.texels.index, near)
        share = np.array(_STEPS_INTO_VIEW)[:, None, None]
        points = (1 - share) * self.points_m[hidden_row] + share * self.points_m[near_row]
        normals = (1 - share) * self.normals[hidden_row] + share * self.normals[near_row]
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
        seen = np.ones(points.shape[:2], bool)  # the last is the visible texel itself
        tested = light_sampling.seen(
            points[:-1].reshape(-1, 3), normals[:-1].reshape(-1, 3), places, self.seed
        )
        seen[:-1] = tested.reshape(seen[:-1].shape) > 0
        first = (seen.argmax(0), np.arange(len(hidden)))
        self.points_m[hidden_row] = points[first]
        self.normals[hidden_row] = normals[first]
        self.visible.ravel()[hidden] = True

    def direct(self, sky: bool = True) -> np.ndarray:
        """(2, N, 3) direct light by two halves of the samples, see light_sampling.direct."""
        materials = list(bpy.data.materials)
        method = functools.partial(light_sampling.direct, materials=materials, sky=sky)
        return self._sampled(method, functools.partial(method, together=True))

    def gathered(self, sky: bool = False) -> np.ndarray:
        """(2, N, 3) light from the surfaces of the open scene, see light_sampling.gathered."""
        method = functools.partial(light_sampling.gathered, sky=sky)
        return self._sampled(method, method)

    def _sampled(
        self, method: Callable[..., np.ndarray], for_hidden: Callable[..., np.ndarray]
    ) -> np.ndarray:
        visible = self.visible.ravel()[self.layout.texels.index]
        light = np.zeros((2, len(visible), 3), np.float32)
        hidden_samples = max(2, self.samples // _HIDDEN_SHARE)
        for rows, sampled, samples in (
            (visible, method, self.samples),
            (~visible, for_hidden, hidden_samples),
        ):
            light[:, rows] = sampled(self.points_m[rows], self.normals[rows], samples, self.seed)
        return light

    def contrast(self, light: np.ndarray) -> np.ndarray:
        """(F, 2) mean squared change of light between neighbouring texels, for each side."""
        image = self.layout.texels.image
        steps = contrast(image(light[0]), image(light[1]), self.chart)
        return self.layout.per_side(steps.ravel()[self.layout.texels.index])

    def map(self, light: np.ndarray) -> np.ndarray:
        """The map (size, size, 3): denoised, with hidden texels next to visible ones and gutters
        filled.
        """
        image = self.layout.texels.image
        smooth = denoise(image(light[0]), image(light[1]), self.chart, self.facing, self.visible)
        filled, reached = fill(smooth, self.visible, self.chart, _GUTTER)
        smooth = np.where(reached[..., None], filled, smooth)
        return fill(smooth, self.chart >= 0, self.chart, _GUTTER)[0].astype(np.float32)
