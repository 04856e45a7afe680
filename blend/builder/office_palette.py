"""Every material of the office, by name; the textures are painted from the seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np

from . import office_textures as tex
from . import paintings, textures
from .materials import glossy, glow, image, matte, polished
from .office_storage import BINDER_CELLS, BOOK_CELLS


class _Painter:
    """Paints images one after the other, each from its own stream of the seed, smaller for a coarse
    room.
    """

    def __init__(self, seed: int, detail: float) -> None:
        self.seed = seed
        self.detail = detail
        self.stream = 0

    def size(self, full: int) -> int:
        return max(64, int(round(full * min(self.detail, 1.0))))

    def __call__(
        self, name: str, paint: Callable[..., np.ndarray], *args: Any, **options: Any
    ) -> bpy.types.Image:
        self.stream += 1
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 177, self.stream]))
        return image("office." + name, paint(rng, *args, **options))


def palette(seed: int, detail: float) -> dict[str, bpy.types.Material]:
    """Materials by short name; Blender names carry the prefix `office.`."""
    paint = _Painter(seed, detail)
    materials = [*_shell(paint), *_furniture(paint), *_prints(paint), *_plain()]
    louvers = paint("louvers", tex.louvers, paint.size(256), (1.0, 0.997, 0.965))
    materials.append(glow("tube light", louvers, 1.05))
    made = {material.name: material for material in materials}
    for name, material in made.items():
        material.name = "office." + name
    return made


def _shell(paint: _Painter) -> list[bpy.types.Material]:
    size = paint.size
    brown = paint("skirting", textures.timber, size(512), (0.30, 0.19, 0.11), (0.42, 0.28, 0.17))
    return [
        matte("wall", paint("paint", tex.paint, size(1536), (0.790, 0.785, 0.745))),
        matte("floor", paint("carpet", tex.carpet, size(2048), (0.31, 0.305, 0.298))),
        matte("ceiling", paint("mineral", tex.mineral, size(1536), (0.69, 0.695, 0.685))),
        polished("rail", (0.20, 0.20, 0.19), 0.27),
        matte("vent", (0.64, 0.64, 0.60)),
        glossy("skirting", brown),
    ]


def _furniture(paint: _Painter) -> list[bpy.types.Material]:
    size = paint.size
    red = paint("laminate", tex.laminate, size(1024), (0.37, 0.28, 0.22), (0.44, 0.335, 0.265), 8)
    beech = paint("beech", textures.timber, size(1024), (0.55, 0.40, 0.26), (0.70, 0.54, 0.37))
    ochre = paint("ochre", tex.worn_paint, size(768), (0.57, 0.476, 0.324))
    return [
        glossy("laminate", red, 1.3),
        glossy("beech", beech),
        glossy("ochre", ochre),
        glossy("grey case", paint("grey", tex.worn_paint, size(512), (0.62, 0.62, 0.60))),
        matte("cloth", paint("cloth", textures.cloth, size(512), 60, (0.20, 0.24, 0.34), 0.35)),
        matte("cork", paint("cork", tex.cork, size(512))),
        glossy("cream", paint("cream", tex.worn_paint, size(512), (0.76, 0.74, 0.66))),
        glossy(
            "door",
            paint("door", textures.timber, size(768), (0.50, 0.36, 0.24), (0.60, 0.45, 0.31)),
        ),
    ]


def _prints(paint: _Painter) -> list[bpy.types.Material]:
    n = paint.size(768)
    wide = (n * 2 // 3, n)
    rocks = paint("rocks", tex.rocks, wide)
    coast = paint("coast", paintings.coast, wide)
    still_life = paint("still life", tex.still_life, (n, n * 3 // 4))
    backs = paint("spines", tex.spines, (n, paint.size(1024)), BOOK_CELLS, BINDER_CELLS)
    return [
        glossy("rocks", rocks),
        glossy("coast", coast),
        glossy("still life", still_life),
        matte("spines", backs),
        matte("pages", paint("pages", tex.pages, paint.size(1024))),
        matte("labels", paint("labels", tex.labels, paint.size(56))),
        glossy("dial", paint("dial", tex.dial, paint.size(512))),
        glow(
            "lit screen",
            paint("spreadsheet", tex.spreadsheet, (paint.size(480), paint.size(640))),
            0.55,
        ),
    ]


def _plain() -> list[bpy.types.Material]:
    return [
        glossy("mat", (0.66, 0.66, 0.64)),
        glossy("black", (0.022, 0.022, 0.024)),
        matte("slot", (0.44, 0.42, 0.335)),
        matte("dark", (0.035, 0.033, 0.030)),
        glossy("screen", (0.008, 0.009, 0.010), 1.5),
        glossy("steel paint", (0.067, 0.068, 0.066)),
        polished("steel", (0.15, 0.15, 0.145), 0.08),
        polished("chrome", (0.25, 0.25, 0.24), 0.15),
        matte("blue board", (0.033, 0.047, 0.066)),
        glossy("blue plastic", (0.17, 0.29, 0.37)),
        glossy("red plastic", (0.26, 0.05, 0.04)),
        matte("red card", (0.48, 0.07, 0.05)),
        matte("green card", (0.10, 0.28, 0.16)),
        matte("buff card", (0.62, 0.48, 0.28)),
        glossy("white plastic", (0.62, 0.62, 0.58)),
        matte("grey keys", (0.36, 0.35, 0.31)),
        matte("key", (0.60, 0.57, 0.48)),
        glossy("yellow", (0.70, 0.42, 0.03)),
        glossy("green glass", (0.16, 0.26, 0.21)),
        glossy("glaze", (0.70, 0.69, 0.65)),
        glossy("coffee", (0.02, 0.011, 0.006)),
        matte("paper", (0.70, 0.68, 0.62)),
        glossy("bulb", (0.75, 0.75, 0.72)),
        glossy("phone", (0.10, 0.105, 0.11)),
        matte("umbrella", (0.02, 0.022, 0.035)),
        glossy("leaf", (0.05, 0.14, 0.04)),
        matte("terracotta", (0.40, 0.17, 0.09)),
    ]
