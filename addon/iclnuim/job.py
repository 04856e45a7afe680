"""The frozen description of a render job <-> JSON: the one contract between panel, farm and worker."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from . import shipped
from .errors import InputError
from .formats.files import read_json
from .geometry.camera import PinholeCamera
from .geometry.scene_axes import SceneReading
from .sensor.exposure import Exposure

SCHEMA_VERSION = 1
#: Effective settings where a job names none. Few samples do for baked light: only reflections and glass are sampled.
LIGHT_DEFAULTS = {"path": {"samples": 64, "denoise": True}, "baked": {"samples": 1, "denoise": False}}


@dataclass(frozen=True)
class RenderJob:
    """What decides the pixels of a run, and nothing else (frames asked for, folder and threads do not).

    `scene` is a shipped scene's name or a file; `trajectory` is a shipped name such as `living_room/kt2` or a file.
    `light` is `path` (full path tracing) or `baked` (light map; reflections and glass traced). `samples` per pixel; `denoise`
    with OpenImageDenoise. Without `antialias` one ray passes through each pixel's centre, as in the paper (section II);
    Z is that of the centre in any case. `lambertian` leaves reflections out. `map_size` (texels) and `map_samples`: the light map's.
    `exposure_s` and `readout_s` (seconds): motion blur and rolling shutter of RGB, see sensor.exposure.
    `reading`: axes and units of a scene file. `ground_truth`: instances and normals beside RGB and Z. Both are left out of the recipe where
    nothing is asked for, so that runs from before they were there keep theirs.
    """

    sequence: str
    scene: str
    trajectory: str
    camera: PinholeCamera = field(default_factory=PinholeCamera)
    light: str = "baked"
    samples: int | None = None
    denoise: bool | None = None
    antialias: bool = False
    lambertian: bool = False
    map_size: int = 2048
    map_samples: int = 32
    seed: int = 0
    exposure_s: float = 0.0
    readout_s: float = 0.0
    reading: SceneReading = field(default_factory=SceneReading)
    ground_truth: bool = False

    def __post_init__(self) -> None:
        if self.light not in LIGHT_DEFAULTS:
            raise InputError("light 'baked' or 'path'", found=self.light)
        for name, value in LIGHT_DEFAULTS[self.light].items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name, least, most in (
            ("samples", 1, 65536),
            ("map_size", 16, 16384),
            ("map_samples", 1, 65536),
            ("seed", 0, 2**31 - 1),
        ):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
                raise InputError(f"{name} as a whole number of {least}..{most}", found=value)
        Exposure(self.exposure_s, self.readout_s)
        for name in ("denoise", "antialias", "lambertian", "ground_truth"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} true or false", found=getattr(self, name))
        for name in ("sequence", "scene", "trajectory"):
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InputError(f"{name} as text", found=getattr(self, name))

    @property
    def exposure(self) -> Exposure:
        """The shutter."""
        return Exposure(self.exposure_s, self.readout_s)

    def to_dict(self) -> dict:
        """The inverse of from_dict."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        late = {"reading": values.pop("reading").to_dict(), "ground_truth": values.pop("ground_truth")}
        made = {"schema_version": SCHEMA_VERSION, **values, "camera": self.camera.to_dict()}
        return {**made, **{key: value for key, value in late.items() if value}}

    @classmethod
    def from_dict(cls, content: dict) -> RenderJob:
        """Raises InputError for unknown keys, a newer schema_version, or values out of range."""
        content = dict(content)
        version = content.pop("schema_version", SCHEMA_VERSION)
        if version != SCHEMA_VERSION:
            raise InputError(f"schema_version {SCHEMA_VERSION}", found=version, hint="a newer iclnuim")
        known = [f.name for f in fields(cls)]
        unknown = sorted(set(content) - set(known))
        if unknown:
            raise InputError(f"the keys {', '.join(known)}", found=", ".join(unknown))
        missing = [key for key in ("sequence", "scene", "trajectory") if key not in content]
        if missing:
            raise InputError(f"the keys {', '.join(missing)}", found="a recipe without them")
        if "camera" in content:
            if not isinstance(content["camera"], dict):
                raise InputError("camera as an object of width, height, fx, fy, cx, cy", found=content["camera"])
            content["camera"] = PinholeCamera.from_dict(content["camera"])
        if "reading" in content:
            content["reading"] = SceneReading.from_dict(content["reading"])
        return cls(**content)

    def changed(self, **settings: object) -> RenderJob:
        """The same job with other settings; None means unchanged. A change of light takes that light's own defaults."""
        settings = {key: value for key, value in settings.items() if value is not None}
        if settings.get("light", self.light) != self.light:
            settings = {"samples": None, "denoise": None, **settings}
        return replace(self, **settings)


def shipped_job(sequence: str) -> RenderJob:
    """The job of `kt2`, `office/kt0`..."""
    name = shipped.full_name(sequence)
    return RenderJob(sequence=name, scene=name.split("/")[0], trajectory=name)


def read_recipe(path: str | os.PathLike[str]) -> RenderJob:
    """A recipe file (or a run's sequence.json). Its paths are relative to it and may not leave its folder.

    Raises InputError with the file's name for anything that does not fit.
    """
    path = Path(path)
    content = read_json(path)
    content = content["job"] if isinstance(content.get("job"), dict) else content
    content.setdefault("sequence", path.stem)
    try:
        job = RenderJob.from_dict(content)
    except InputError as error:
        raise InputError(error.expected, path=path, found=error.found, hint=error.hint) from None
    return replace(
        job,
        scene=_inside(path, job.scene, shipped.SCENE_NAMES),
        trajectory=_inside(path, job.trajectory, shipped.sequence_names()),
        reading=replace(job.reading, textures=job.reading.textures and _inside(path, job.reading.textures, ())),
    )


def _inside(recipe: Path, name: str, shipped_names: object) -> str:
    """A shipped name stays; a path is taken from the recipe's folder, which it may not leave."""
    if name in shipped_names:
        return name
    folder = recipe.resolve().parent
    target = (folder / name).resolve()
    if not target.is_relative_to(folder):
        raise InputError(
            "paths inside the recipe's own folder", path=recipe, found=name, hint="moving the file beside the recipe"
        )
    return str(target)
