"""Writes a ViewContents as one HTML file with pictures, numbers and the script that draws them."""

import base64
import json
import re
import tempfile
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ...console import Meter, advance_of
from ...errors import StrPath, WorkError
from ...formats.files import atomic_write_text
from ...formats.libraries import first_library
from ...shown import COLOURS, depth_range, ramp
from .contents import ViewContents, ViewedFrame, ViewedSequence, ViewedSurface, ViewedTrajectory
from .packing import packed_bytes, packed_floats, packed_whole

_HERE = Path(__file__).parent
#: What the images of a page with one sequence, and with two, may take. A page of 15 MB opens at
#: once in a browser and can be sent by mail.
MAX_BYTES = {1: 14_000_000, 2: 24_000_000}
#: WebP's quality of colour. At 90 a difference to the original is not visible at the size of the
#: screen; noisy frames have about 90 kB.
_QUALITY = 90
_TRUTH_COLOUR = "#808890"
_HOLE = re.compile(r"\{\{ (\w+) \}\}")


def write_page(
    path: StrPath, view: ViewContents, exact: bool = False, progress: Meter = None
) -> list[str]:
    """Write the page. Returns notes about what it leaves out.

    Depth is stored in each pixel; where the page would be too large, unless `exact`, in every
    second row and column. progress: as of render_frames(). Raises InputError for an image that
    cannot be read, WorkError without a library that writes WebP.
    """
    packer = _Packer()
    advance = advance_of(progress, sum(len(one.frames) for one in view.sequences), "view")
    sequences = [packer.sequence(one, advance) for one in view.sequences]
    notes = packer.depth(sequences, exact)
    content = {
        "ramp": np.rint(255 * ramp(np.linspace(0, 1, 256))).astype(int).ravel().tolist(),
        "sequences": sequences,
        "trajectories": packer.trajectories(view),
        "surfaces": [packer.surface(one) for one in view.surfaces],
    }
    data = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
    blobs = (f'<script type="text/plain" id="{name}">{text}</script>' for name, text in packer)
    holes = {
        "title": escape(view.title),
        "notes": "".join(f"<p>{escape(note)}</p>" for note in [*view.notes, *notes]),
        "css": _own("view.css"),
        "blobs": "\n".join(blobs),
        "data": data,
        "licence": _own("regl.LICENSE"),
        "regl": _own("regl.min.js"),
        "script": _own("view.js"),
    }
    page = _HOLE.sub(lambda hole: holes[hole[1]], _own("view.html"))
    atomic_write_text(path, page)
    return notes


def _own(name: str) -> str:
    return (_HERE / name).read_text("utf-8")


class _Packer:
    """Packs what a page shows; texts by their name in the page."""

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._whole: list[tuple[dict, str, str]] = []  # frame, its depth in all pixels, and in few

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self._texts.items())

    def _put(self, text: str) -> str:
        name = f"b{len(self._texts)}"
        self._texts[name] = text
        return name

    def sequence(self, sequence: ViewedSequence, advance: Callable[[], object]) -> dict[str, Any]:
        """A sequence with its colour images; depth() adds those of depth."""
        frames = []
        near_far = []
        for frame in sequence.frames:
            rgb, depth_z_m = frame.load()
            near_far.append(depth_range(depth_z_m))
            frames.append(self._frame(frame, rgb, depth_z_m, sequence.units_per_metre))
            advance()
        near_m, far_m = np.median(near_far, axis=0).tolist()
        camera = {name: getattr(sequence.camera, name) for name in ("fx", "fy", "cx", "cy")}
        size = {"width": sequence.camera.width, "height": sequence.camera.height}
        shown = {"near_m": near_m, "far_m": far_m, "units_per_metre": sequence.units_per_metre}
        return {"name": sequence.name, **size, **camera, **shown, "frames": frames}

    def _frame(
        self, frame: ViewedFrame, rgb: np.ndarray, depth_z_m: np.ndarray, units_per_metre: float
    ) -> dict[str, Any]:
        units = np.rint(np.nan_to_num(depth_z_m, posinf=0) * units_per_metre)
        units = np.where((units > 0) & (units < 1 << 16), units, 0).astype(np.uint16)
        pose = frame.T_world_camera
        found = {
            "number": frame.number,
            "stamp_s": frame.stamp_s,
            "pose": None
            if pose is None
            else [*pose.translation.tolist(), *pose.quat_xyzw.tolist()],
            "colour": self._put(_webp(rgb)),
        }
        self._whole.append((found, packed_whole(units), packed_whole(units[::2, ::2])))
        return found

    def depth(self, sequences: list[dict[str, Any]], exact: bool) -> list[str]:
        """Add the depth of all frames, in all pixels if there is room. Returns a note if not."""
        room = MAX_BYTES[min(max(len(sequences), 1), 2)] - sum(map(len, self._texts.values()))
        whole = exact or sum(len(every) for _, every, _ in self._whole) <= room
        step = 1 if whole else 2
        for frame, every, second in self._whole:
            frame["depth"] = self._put(every if whole else second)
        for one in sequences:
            sizes = {f"depth_{side}": -(-one[side] // step) for side in ("width", "height")}
            one |= {"depth_step": step, **sizes}
        if whole:
            return []
        return ["depth is shown in every second row and column, to keep the file small"]

    def trajectories(self, view: ViewContents) -> list[dict[str, Any]]:
        colours = iter(colour for colour in COLOURS * len(view.trajectories))
        return [
            self._trajectory(one, _TRUTH_COLOUR if one.is_truth else next(colours))
            for one in view.trajectories
        ]

    def _trajectory(self, one: ViewedTrajectory, colour: str) -> dict[str, Any]:
        poses = one.trajectory.T_world_camera
        errors_mm = None if one.errors_m is None else self._put(packed_floats(1e3 * one.errors_m))
        return {
            "label": one.label,
            "colour": colour,
            "is_truth": one.is_truth,
            "has_rotations": one.has_rotations,
            "count": len(one.trajectory),
            "stamps": self._put(packed_floats(one.trajectory.stamps_s, "<f8")),
            "poses": self._put(packed_floats(np.hstack([poses.translation, poses.quat_xyzw]))),
            "errors": errors_mm,
        }

    def surface(self, one: ViewedSurface) -> dict[str, Any]:
        """Positions are whole numbers of 65,535ths of the extent: 0.1 mm in a room."""
        low, high = one.points.min(axis=0), one.points.max(axis=0)
        share = (one.points - low) / np.maximum(high - low, 1e-12)
        places = np.rint(65535 * share).astype(np.uint16)
        found: dict[str, Any] = {"name": one.name, "low": low.tolist(), "high": high.tolist()}
        inner = np.percentile(one.points, (2, 98), axis=0).tolist()
        found |= dict(zip(("from", "to"), inner, strict=True))  # what the page looks at first
        found |= {axis: self._put(packed_whole(places[:, k])) for k, axis in enumerate("xyz")}
        if len(one.triangles):
            found["triangles"] = self._put(packed_whole(one.triangles.astype(np.uint32)))
        if one.distances_m is not None:
            part = np.clip(1e3 * one.distances_m / one.max_mm, 0, 1)
            shares = np.rint(255 * part).astype(np.uint8)
            found |= {"shares": self._put(packed_bytes(shares.tobytes())), "max_mm": one.max_mm}
        elif one.colours is not None and one.colours.shape[1] >= 3:
            colours = np.ascontiguousarray(one.colours[:, :3], np.uint8)
            found["colours"] = self._put(packed_bytes(colours.tobytes()))
        return found


def _webp(rgb: np.ndarray) -> str:
    name, library = first_library("a page with images", "cv2", "OpenImageIO")
    if name == "cv2":
        image = np.ascontiguousarray(rgb[..., ::-1])
        data = library.imencode(".webp", image, [library.IMWRITE_WEBP_QUALITY, _QUALITY])[1]
        return base64.b64encode(data).decode()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "colour.webp"
        spec = library.ImageSpec(rgb.shape[1], rgb.shape[0], 3, library.UINT8)
        spec.attribute("compression", f"webp:{_QUALITY}")
        output = library.ImageOutput.create(str(file))
        if not (output and output.open(str(file), spec) and output.write_image(rgb)):
            raise WorkError("this OpenImageIO does not write WebP")
        output.close()
        return base64.b64encode(file.read_bytes()).decode()
