"""Bakes and compresses the light that is shipped with the built-in rooms, into blend/light. `python
tools/ship_light.py [ROOM]...`

It uses a lossy EXR codec (DWAB) at the strongest level with a PSNR of at least 55 dB, over lit
texels in display values.
"""

import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from iclnuim import shipped
from iclnuim.blender.light import light_files
from iclnuim.blender.open import scene
from iclnuim.blender.render.job_scene import JobScene
from iclnuim.formats.exr import read_exr
from iclnuim.formats.files import write_json
from iclnuim.job import shipped_job
from iclnuim.sensor.transfer import srgb_from_light
from iclnuim.worker_events import Event, Note

LEVELS = (400, 200, 100, 45, 20, 10, 5, 2)
MIN_DB = 55.0


def psnr_db(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> float:
    """PSNR of two maps {"R", "G", "B": (rows, columns)} over the texels that are lit in the first,
    of sRGB values 0..1.
    """
    a = np.stack([first[name] for name in "RGB"], -1).astype(np.float64)
    b = np.stack([second[name] for name in "RGB"], -1).astype(np.float64)
    lit = a.max(-1) > 0
    difference = srgb_from_light(a[lit]) - srgb_from_light(b[lit])
    return float(-10 * np.log10(np.mean(difference**2)))


def ship(room: str) -> str:
    """Bake the map of `room` with the default settings, or read it from the cache, and write
    blend/light/ROOM; returns a line about it.
    """
    job = shipped_job(f"{room}/kt0")
    target = shipped.folder("blend") / "light" / room
    shutil.rmtree(target, ignore_errors=True)

    def listen(event: Event) -> None:
        if isinstance(event, Note):
            print(event.text, flush=True)

    made, _ = JobScene(job, listen).bake()
    target.mkdir(parents=True)
    light = read_exr(made / light_files.MAP)
    for level in LEVELS:
        write(target / light_files.MAP, light, level)
        quality_db = psnr_db(light, read_exr(target / light_files.MAP))
        if quality_db >= MIN_DB:
            break
    shutil.copyfile(made / light_files.LAYOUT, target / light_files.LAYOUT)
    fits = {
        "scene_sha256": scene.scene_sha256(room),
        "size": job.map_size,
        "samples": job.map_samples,
    }
    recipe = {
        **light_files.read_recipe(made),
        "fits": fits,
        "codec": f"DWAB {level}",
        "psnr_db": round(quality_db, 2),
    }
    write_json(target / light_files.RECIPE, recipe)
    size = sum(file.stat().st_size for file in target.iterdir())
    figures = {"room": room, "bytes": size, "level": level, "psnr_db": round(quality_db, 2)}
    return json.dumps(figures)


def write(path: Path, channels: dict[str, np.ndarray], level: float) -> None:
    """Write the pixels with lossy compression; level: strength of the codec, as in OpenEXR."""
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.DWAB_COMPRESSION,
        "dwaCompressionLevel": float(level),
    }
    with OpenEXR.File(header, dict(channels)) as file:
        file.write(os.fspath(path))


if __name__ == "__main__":
    for name in sys.argv[1:] or shipped.SCENE_NAMES:
        print(ship(name), flush=True)
    os._exit(0)  # at exit, bpy may wait for Blender's threads
