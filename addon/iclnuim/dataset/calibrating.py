"""Reading what a calibration needs from a folder: a static exposure series, static walls."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..formats.files import read_text
from ..formats.png import read_depth16, read_rgb8
from ..formats.table import data_lines
from ..sensor.calibration import DepthCalibration, RgbCalibration, calibrate_depth, calibrate_rgb
from .depth_units import UNITS_PER_METRE, metres_from_depth16

EXPOSURES = "exposures.txt"


def calibrate_folder(
    folder: Path, units_per_metre: float = UNITS_PER_METRE, sigma_s_px: float = 0.5
) -> tuple[RgbCalibration | None, DepthCalibration | None]:
    """Calibrations of what lies there: `exposures.txt` (lines `exposure image.png`, two or more images of each exposure
    of a static scene), `depth/*.png` (one static wall) or `wall*/*.png` (several walls). Raises InputError for neither.
    """
    folder = Path(folder)
    rgb = _rgb(folder / EXPOSURES) if (folder / EXPOSURES).is_file() else None
    walls = [d for d in (folder / "depth", *sorted(folder.glob("wall*"))) if d.is_dir() and any(d.glob("*.png"))]
    depth = _depth(walls, units_per_metre, sigma_s_px) if walls else None
    if rgb is None and depth is None:
        raise InputError(f"{EXPOSURES}, depth/*.png or wall*/*.png", path=folder, found="none of them")
    return rgb, depth


def _rgb(file: Path) -> RgbCalibration:
    images: dict[float, list[np.ndarray]] = {}
    for number, line in data_lines(read_text(file)):
        fields = line.split()
        try:
            exposure, path = float(fields[0]), file.parent / fields[1]
        except (ValueError, IndexError):
            raise InputError("lines `exposure image.png`", path=file, line=number, found=line) from None
        images.setdefault(exposure, []).append(read_rgb8(path))
    shapes = {image.shape for stack in images.values() for image in stack}
    if len(shapes) != 1:
        raise InputError("images of one size", path=file, found=sorted(shapes))
    return calibrate_rgb(list(images), [np.stack(stack) for stack in images.values()])


def _depth(walls: list[Path], units_per_metre: float, sigma_s_px: float) -> DepthCalibration:
    stacks = []
    for wall in walls:
        frames = [read_depth16(path) for path in sorted(wall.glob("*.png"))]
        if len({frame.shape for frame in frames}) != 1:
            raise InputError("depth images of one size", path=wall, found="several")
        stacks.append(metres_from_depth16(np.stack(frames), units_per_metre))
    return calibrate_depth(stacks, sigma_s_px=sigma_s_px)
