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
    return {
        k: max(32, int(round(v * min(detail, 1.0))))
        for k, v in {"large": 2048, "wall": 1536, "mid": 1024, "cloth": 768, "small": 512}.items()
    }


class Painter:
    """Paints images one after the other, each from its own stream of the seed."""

    def __init__(self, seed: int) -> None:
        self.seed, self.stream = seed, 0

    def __call__(self, name: str, paint: Callable[..., np.ndarray], *args: Any) -> bpy.types.Image:
        self.stream += 1
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 77, self.stream]))
        return image("living_room." + name, paint(rng, *args))


def palette(seed: int, detail: float) -> dict[str, bpy.types.Material]:
    """Materials by short name; Blender names carry the prefix `living_room.`."""
    size, paint = _sizes(detail), Painter(seed)
    made = {
        **_shell(paint, size),
        **_cloths(paint, size),
        **_woods(paint, size),
        **_pictures(paint, size),
        **_plain(paint, size),
    }
    for name, material in made.items():
        material.name = "living_room." + name
    return made


def _shell(paint: Painter, size: dict[str, int]) -> dict[str, bpy.types.Material]:
    return {
        "wall": matte(
            "wall", paint("plaster", textures.plaster, size["wall"], (0.768, 0.768, 0.740), 0.88)
        ),
        "ceiling": matte(
            "ceiling",
            paint("ceiling", textures.plaster, size["small"], (0.845, 0.835, 0.820), 0.06),
        ),
        "floor": glossy(
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
        "white paint": glossy("white paint", (0.74, 0.74, 0.73)),
        "paving": matte(
            "paving", paint("paving", textures.stone, size["small"], (0.70, 0.66, 0.60), 4)
        ),
    }


def _cloths(paint: Painter, size: dict[str, int]) -> dict[str, bpy.types.Material]:
    n = size["cloth"]
    linen = paint("linen", textures.cloth, n, 90, (0.90, 0.875, 0.82), 0.10, 0.025)
    return {
        "sofa": matte(
            "sofa",
            paint(
                "upholstery", textures.cloth, size["small"], 28, (0.78, 0.80, 0.825), 0.16, 0.015
            ),
        ),
        "crimson": matte(
            "crimson", paint("crimson", textures.cloth, n, 64, (0.41, 0.155, 0.25), 0.32)
        ),
        "blue": matte("blue", paint("blue", textures.cloth, n, 64, (0.28, 0.37, 0.48), 0.28)),
        "ochre": matte("ochre", paint("ochre", textures.cloth, n, 56, (0.80, 0.58, 0.26), 0.32)),
        "grey seat": matte(
            "grey seat", paint("grey", textures.cloth, n, 60, (0.46, 0.48, 0.50), 0.30)
        ),
        "knit": matte(
            "knit", paint("knit", textures.boucle, size["small"], 18, (0.62, 0.66, 0.64), 0.45)
        ),
        "rug": matte("rug", paint("rug", textures.rug, size["mid"])),
        "fringe": matte("fringe", (0.62, 0.55, 0.43)),
        "curtain": thin_cloth("curtain", linen, 0.42),
        "shade": thin_cloth(
            "shade", paint("shade", textures.cloth, n, 90, (0.90, 0.83, 0.72), 0.10, 0.02), 0.25
        ),
    }


def _woods(paint: Painter, size: dict[str, int]) -> dict[str, bpy.types.Material]:
    walnut = paint("walnut", textures.timber, size["mid"], (0.19, 0.115, 0.07), (0.28, 0.175, 0.11))
    nut = paint("nut", textures.timber, size["mid"], (0.29, 0.18, 0.11), (0.50, 0.34, 0.22), 5)
    oak = paint("oak", textures.timber, size["mid"], (0.60, 0.42, 0.25), (0.76, 0.58, 0.39))
    return {
        "nut": glossy("nut", nut),
        "frame wood": glossy("frame wood", walnut),
        "oak": glossy("oak", oak),
    }


def _pictures(paint: Painter, size: dict[str, int]) -> dict[str, bpy.types.Material]:
    w = size["mid"]
    return {
        "mat": glossy("mat", (0.80, 0.80, 0.78)),
        "landscape": glossy("landscape", paint("landscape", paintings.landscape, (w * 2 // 3, w))),
        "coast": glossy("coast", paint("coast", paintings.coast, (w * 2 // 3, w))),
        "view": glow(
            "view", paint("view", paintings.view, (size["small"], size["large"]), paint.seed), 1.6
        ),
    }


def _plain(paint: Painter, size: dict[str, int]) -> dict[str, bpy.types.Material]:
    return {
        "steel": polished("steel", (0.30, 0.295, 0.28), 0.08),
        "trim": glossy("trim", (0.16, 0.16, 0.16)),
        "brass": polished("brass", (0.42, 0.27, 0.08), 0.2),
        "dark metal": glossy("dark metal", (0.03, 0.03, 0.032)),
        "lens": glow("lens", (1.0, 0.93, 0.80), 9.0),
        "bulb": glow("bulb", (1.0, 0.78, 0.50), 8.0),
        "glass": pane("glass"),
        "screen": glossy("screen", (0.010, 0.010, 0.012), 1.5),
        "leaf": glossy("leaf", paint("leaf", textures.leaf, size["small"])),
        "stalk": glossy("stalk", (0.055, 0.13, 0.035)),
        "pot": glossy("pot", (0.55, 0.53, 0.49)),
        "soil": matte("soil", (0.035, 0.024, 0.016)),
        "glaze": glossy("glaze", (0.05, 0.16, 0.20)),
        "porcelain": glossy("porcelain", (0.72, 0.71, 0.68)),
        "orange": glossy("orange", (0.75, 0.25, 0.03)),
        "bark": matte("bark", (0.10, 0.065, 0.04)),
        "bud": matte("bud", (0.62, 0.60, 0.55)),
        "paper": matte("paper", (0.74, 0.71, 0.64)),
        "book red": glossy("book red", (0.30, 0.035, 0.03)),
        "book blue": glossy("book blue", (0.03, 0.07, 0.16)),
        "book cream": glossy("book cream", (0.60, 0.54, 0.42)),
        "terracotta": matte("terracotta", (0.42, 0.17, 0.09)),
        "shrub": matte("shrub", (0.07, 0.17, 0.04)),
    }
