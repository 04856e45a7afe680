"""Every material of the living room, by name; the textures are painted from the seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np

from . import paintings, textures
from .materials import glossy, glow, image, matte, pane, polished, thin_cloth


def _sizes(detail: float) -> dict[str, int]:
    """Texture edge lengths in pixels, smaller for a coarse room."""
    full = {"large": 2048, "wall": 1536, "mid": 1024, "cloth": 768, "small": 512}
    return {name: max(32, int(round(size * min(detail, 1.0)))) for name, size in full.items()}


class Painter:
    """Paints images one after the other, each from its own stream of the seed."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.stream = 0

    def __call__(
        self, name: str, paint: Callable[..., np.ndarray], *args: Any, **options: Any
    ) -> bpy.types.Image:
        self.stream += 1
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 77, self.stream]))
        return image("living_room." + name, paint(rng, *args, **options))


def palette(seed: int, detail: float) -> dict[str, bpy.types.Material]:
    """Materials by short name; Blender names carry the prefix `living_room.`."""
    size = _sizes(detail)
    paint = Painter(seed)
    made = {}
    for group in (_shell, _cloths, _woods, _pictures, _plain):
        made.update({material.name: material for material in group(paint, size)})
    for name, material in made.items():
        material.name = "living_room." + name
    return made


def _shell(paint: Painter, size: dict[str, int]) -> list[bpy.types.Material]:
    return [
        matte(
            "wall", paint("plaster", textures.plaster, size["wall"], (0.768, 0.768, 0.740), 0.88)
        ),
        matte(
            "ceiling",
            paint("ceiling", textures.plaster, size["small"], (0.845, 0.835, 0.820), 0.06),
        ),
        glossy(
            "floor",
            paint(
                "boards",
                textures.boards,
                size["large"],
                22,
                (0.36, 0.185, 0.115),
                (0.60, 0.365, 0.25),
            ),
            1.38,
        ),
        glossy("white paint", (0.74, 0.74, 0.73)),
        matte("paving", paint("paving", textures.stone, size["small"], (0.70, 0.66, 0.60), 4)),
    ]


def _cloths(paint: Painter, size: dict[str, int]) -> list[bpy.types.Material]:
    n = size["cloth"]
    linen = paint("linen", textures.cloth, n, 90, (0.90, 0.875, 0.82), depth=0.10, slub=0.025)
    return [
        matte(
            "sofa",
            paint(
                "upholstery",
                textures.cloth,
                size["small"],
                28,
                (0.78, 0.80, 0.825),
                depth=0.16,
                slub=0.015,
            ),
        ),
        matte("crimson", paint("crimson", textures.cloth, n, 64, (0.41, 0.155, 0.25), 0.32)),
        matte("blue", paint("blue", textures.cloth, n, 64, (0.28, 0.37, 0.48), 0.28)),
        matte("ochre", paint("ochre", textures.cloth, n, 56, (0.80, 0.58, 0.26), 0.32)),
        matte("grey seat", paint("grey", textures.cloth, n, 60, (0.46, 0.48, 0.50), 0.30)),
        matte("knit", paint("knit", textures.boucle, size["small"], 18, (0.62, 0.66, 0.64), 0.45)),
        matte("rug", paint("rug", textures.rug, size["mid"])),
        matte("fringe", (0.62, 0.55, 0.43)),
        thin_cloth("curtain", linen, 0.42),
        thin_cloth(
            "shade",
            paint("shade", textures.cloth, n, 90, (0.90, 0.83, 0.72), depth=0.10, slub=0.02),
            0.25,
        ),
    ]


def _woods(paint: Painter, size: dict[str, int]) -> list[bpy.types.Material]:
    walnut = paint("walnut", textures.timber, size["mid"], (0.19, 0.115, 0.07), (0.28, 0.175, 0.11))
    nut = paint("nut", textures.timber, size["mid"], (0.29, 0.18, 0.11), (0.50, 0.34, 0.22), 5)
    oak = paint("oak", textures.timber, size["mid"], (0.60, 0.42, 0.25), (0.76, 0.58, 0.39))
    return [glossy("nut", nut), glossy("frame wood", walnut), glossy("oak", oak)]


def _pictures(paint: Painter, size: dict[str, int]) -> list[bpy.types.Material]:
    w = size["mid"]
    return [
        glossy("mat", (0.80, 0.80, 0.78)),
        glossy("landscape", paint("landscape", paintings.landscape, (w * 2 // 3, w))),
        glossy("coast", paint("coast", paintings.coast, (w * 2 // 3, w))),
        glow(
            "view", paint("view", paintings.view, (size["small"], size["large"]), paint.seed), 1.6
        ),
    ]


def _plain(paint: Painter, size: dict[str, int]) -> list[bpy.types.Material]:
    return [
        polished("steel", (0.30, 0.295, 0.28), 0.08),
        glossy("trim", (0.16, 0.16, 0.16)),
        polished("brass", (0.42, 0.27, 0.08), 0.2),
        glossy("dark metal", (0.03, 0.03, 0.032)),
        glow("lens", (1.0, 0.93, 0.80), 9.0),
        glow("bulb", (1.0, 0.78, 0.50), 8.0),
        pane("glass"),
        glossy("screen", (0.010, 0.010, 0.012), 1.5),
        glossy("leaf", paint("leaf", textures.leaf, size["small"])),
        glossy("stalk", (0.055, 0.13, 0.035)),
        glossy("pot", (0.55, 0.53, 0.49)),
        matte("soil", (0.035, 0.024, 0.016)),
        glossy("glaze", (0.05, 0.16, 0.20)),
        glossy("porcelain", (0.72, 0.71, 0.68)),
        glossy("orange", (0.75, 0.25, 0.03)),
        matte("bark", (0.10, 0.065, 0.04)),
        matte("bud", (0.62, 0.60, 0.55)),
        matte("paper", (0.74, 0.71, 0.64)),
        glossy("book red", (0.30, 0.035, 0.03)),
        glossy("book blue", (0.03, 0.07, 0.16)),
        glossy("book cream", (0.60, 0.54, 0.42)),
        matte("terracotta", (0.42, 0.17, 0.09)),
        matte("shrub", (0.07, 0.17, 0.04)),
    ]
