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
        self.seed, self.detail, self.stream = seed, detail, 0

    def size(self, full: int) -> int:
        return max(64, int(round(full * min(self.detail, 1.0))))

    def __call__(self, name: str, paint: Callable[..., np.ndarray], *args: Any) -> bpy.types.Image:
        self.stream += 1
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 177, self.stream]))
        return image("office." + name, paint(rng, *args))


def palette(seed: int, detail: float) -> dict[str, bpy.types.Material]:
    """Materials by short name; Blender names carry the prefix `office.`."""
    paint = _Painter(seed, detail)
    made = {**_shell(paint), **_furniture(paint), **_prints(paint), **_plain()}
    made["tube light"] = glow(
        "tube light", paint("louvers", tex.louvers, paint.size(256), (1.0, 0.997, 0.965)), 1.05
    )
    for name, material in made.items():
        material.name = "office." + name
    return made


def _shell(paint: _Painter) -> dict[str, bpy.types.Material]:
    size = paint.size
    brown = paint("skirting", textures.timber, size(512), (0.30, 0.19, 0.11), (0.42, 0.28, 0.17))
    return {
        "wall": matte("wall", paint("paint", tex.paint, size(1536), (0.790, 0.785, 0.745))),
        "floor": matte("floor", paint("carpet", tex.carpet, size(2048), (0.31, 0.305, 0.298))),
        "ceiling": matte(
            "ceiling", paint("mineral", tex.mineral, size(1536), (0.69, 0.695, 0.685))
        ),
        # measured in 12 official frames: a bar reflects 0.27 of the wall's light, plus 0.015
        # (correlation 0.96)
        "rail": polished("rail", (0.20, 0.20, 0.19), 0.27),
        "vent": matte("vent", (0.64, 0.64, 0.60)),
        "skirting": glossy("skirting", brown),
    }


def _furniture(paint: _Painter) -> dict[str, bpy.types.Material]:
    size = paint.size
    red = paint("laminate", tex.laminate, size(1024), (0.37, 0.28, 0.22), (0.44, 0.335, 0.265), 8)
    beech = paint("beech", textures.timber, size(1024), (0.55, 0.40, 0.26), (0.70, 0.54, 0.37))
    ochre = paint("ochre", tex.worn_paint, size(768), (0.57, 0.476, 0.324))
    return {
        "laminate": glossy("laminate", red, 1.3),
        "beech": glossy("beech", beech),
        "ochre": glossy("ochre", ochre),
        "grey case": glossy(
            "grey case", paint("grey", tex.worn_paint, size(512), (0.62, 0.62, 0.60))
        ),
        "cloth": matte(
            "cloth", paint("cloth", textures.cloth, size(512), 60, (0.20, 0.24, 0.34), 0.35)
        ),
        "cork": matte("cork", paint("cork", tex.cork, size(512))),
        "cream": glossy("cream", paint("cream", tex.worn_paint, size(512), (0.76, 0.74, 0.66))),
        "door": glossy(
            "door",
            paint("door", textures.timber, size(768), (0.50, 0.36, 0.24), (0.60, 0.45, 0.31)),
        ),
    }


def _prints(paint: _Painter) -> dict[str, bpy.types.Material]:
    n = paint.size(768)
    shapes = {"rocks": tex.rocks, "coast": paintings.coast, "still life": tex.still_life}
    made = {
        k: glossy(k, paint(k, f, (n, n * 3 // 4) if k == "still life" else (n * 2 // 3, n)))
        for k, f in shapes.items()
    }
    backs = paint("spines", tex.spines, (n, paint.size(1024)), BOOK_CELLS, BINDER_CELLS)
    return {
        **made,
        "spines": matte("spines", backs),
        "pages": matte("pages", paint("pages", tex.pages, paint.size(1024))),
        "labels": matte("labels", paint("labels", tex.labels, paint.size(56))),
        "dial": glossy("dial", paint("dial", tex.dial, paint.size(512))),
        "lit screen": glow(
            "lit screen",
            paint("spreadsheet", tex.spreadsheet, (paint.size(480), paint.size(640))),
            0.55,
        ),
    }


def _plain() -> dict[str, bpy.types.Material]:
    return {
        "mat": glossy("mat", (0.66, 0.66, 0.64)),
        "black": glossy("black", (0.022, 0.022, 0.024)),
        "slot": matte("slot", (0.44, 0.42, 0.335)),
        "dark": matte("dark", (0.035, 0.033, 0.030)),
        "screen": glossy("screen", (0.008, 0.009, 0.010), 1.5),
        "steel paint": glossy("steel paint", (0.067, 0.068, 0.066)),
        "steel": polished("steel", (0.15, 0.15, 0.145), 0.08),
        "chrome": polished("chrome", (0.25, 0.25, 0.24), 0.15),
        "blue board": matte("blue board", (0.033, 0.047, 0.066)),
        "blue plastic": glossy("blue plastic", (0.17, 0.29, 0.37)),
        "red plastic": glossy("red plastic", (0.26, 0.05, 0.04)),
        "red card": matte("red card", (0.48, 0.07, 0.05)),
        "green card": matte("green card", (0.10, 0.28, 0.16)),
        "buff card": matte("buff card", (0.62, 0.48, 0.28)),
        "white plastic": glossy("white plastic", (0.62, 0.62, 0.58)),
        "grey keys": matte("grey keys", (0.36, 0.35, 0.31)),
        "key": matte("key", (0.60, 0.57, 0.48)),
        "yellow": glossy("yellow", (0.70, 0.42, 0.03)),
        "green glass": glossy("green glass", (0.16, 0.26, 0.21)),
        "glaze": glossy("glaze", (0.70, 0.69, 0.65)),
        "coffee": glossy("coffee", (0.02, 0.011, 0.006)),
        "paper": matte("paper", (0.70, 0.68, 0.62)),
        "bulb": glossy("bulb", (0.75, 0.75, 0.72)),
        "phone": glossy("phone", (0.10, 0.105, 0.11)),
        "umbrella": matte("umbrella", (0.02, 0.022, 0.035)),
        "leaf": glossy("leaf", (0.05, 0.14, 0.04)),
        "terracotta": matte("terracotta", (0.40, 0.17, 0.09)),
    }
