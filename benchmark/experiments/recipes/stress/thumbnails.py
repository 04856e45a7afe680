"""Small pictures of perturbed frames for the page of `iclnuim stress`: colour above depth, of the
middle frame of the first segment. They are kept in OUT/thumbnails, named by what decides them.
"""

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from iclnuim.console import Console
from iclnuim.formats.files import atomic_write_bytes, make_folder
from iclnuim.shown import depth_colours, depth_range

from ....perturbations.plan import CLEAN
from .recipe import Stress, StressKey

_WIDTH = 160
_QUALITY = 80
#: (perturbation, severity) -> data URI of a picture; (CLEAN, 0) is unperturbed.
Pictures = Mapping[tuple[str, int], str]


def thumbnails(stress: Stress, out: Path, console: Console) -> Pictures:
    """The picture of every perturbation and severity; none without a sequence."""
    first = next(stress.segment_keys(), None)
    if first is None:
        return {}
    wanted = [(CLEAN, 0), *product(stress.perturbations, stress.severities)]
    make_folder(out / "thumbnails")
    range_m: tuple[float, float] | None = None
    found = {}
    advance = console.progress(len(wanted), "pictures", "frames").advance
    for name, severity in wanted:
        key = replace(first, perturbation=name, severity=severity)
        file = out / "thumbnails" / f"{_identity(stress, key)}.jpg"
        if not file.is_file():
            if range_m is None:
                clean = stress.clean_segment(first)
                range_m = depth_range(clean.load(clean.middle)[1])
            atomic_write_bytes(file, _picture(stress, key, range_m))
        text = base64.b64encode(file.read_bytes()).decode()
        found[name, severity] = f"data:image/jpeg;base64,{text}"
        advance(1)
    return found


def _identity(stress: Stress, key: StressKey) -> str:
    about = [*key.words, stress.frames_identity(key), _WIDTH, _QUALITY]
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:24]


def _picture(stress: Stress, key: StressKey, range_m: tuple[float, float]) -> bytes:
    segment = stress.segment(key)
    colour, depth_z_m = segment.load(segment.middle)
    both = np.vstack([colour, depth_colours(depth_z_m, *range_m)])
    height = round(_WIDTH * both.shape[0] / both.shape[1])
    small = cv2.resize(both, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    code = cv2.imencode(".jpg", small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return code.tobytes()
