"""What the files of a sequence say of its camera: our camera.json, cameras of other programs and
how they are mounted, and the keys that a reader does not apply.

Of every such key is known whether its value changes anything. It is refused or named, so that
nothing that a file says is ignored without a word.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, within
from ..formats.depth_units import UNITS_PER_METRE, check_units
from ..formats.files import data_lines, read_json, read_text
from ..formats.images import image_header
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

CAMERA = "camera.json"
DISTORTED = (
    "the lens distortion in the camera's file is ignored: "
    "images are read as those of a pinhole camera"
)


def names(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


#: Names of the coefficients of a distortion,
COEFFICIENTS = names("k1 k2 k3 k4 k5 k6 p1 p2 distortion distortion_params")
#: and of distortion models (of EuRoC, Kalibr, ROS and VSLAM-LAB) that are a pinhole camera if
#: all coefficients are 0; an equidistant one is a fisheye then.
WITHOUT_PROJECTION = (
    *("radial-tangential", "radtan", "radtan4", "radtan5", "radtan8"),
    *("plumb_bob", "rational_polynomial", "none", ""),
)
#: Larger entries of a matrix, or differences from the identity, have an effect.
_SAME = 1e-6

#: Whether a value changes nothing.
Neutral = Callable[[Any], bool]


@dataclass(frozen=True)
class Keys:
    """The keys of a kind of file.

    used: those that the reader applies. harmless: those without an effect on camera, depth and
    poses, whatever their value. noted: not applied; named unless their value is neutral. required:
    those that change the projection or the axes; refused unless their value is neutral. distortion:
    coefficients of a lens distortion, which is ignored with a note. Any other key is named.
    """

    used: frozenset[str]
    harmless: frozenset[str] = frozenset()
    noted: Mapping[str, Neutral] = field(default_factory=dict)
    required: Mapping[str, Neutral] = field(default_factory=dict)
    distortion: frozenset[str] = frozenset()

    def notes(self, said: Iterable[Mapping[str, Any]], path: Path) -> tuple[str, ...]:
        """A sentence for everything that is not applied, of mappings from one file.

        Raises InputError for a value that a pinhole camera cannot have.
        """
        unused: dict[str, str] = {}
        found: list[str] = []
        for key, value in _entries(said):
            if key in self.required and not self.required[key](value):
                expected = "the settings of a pinhole camera"
                raise InputError(expected, path=path, found=f"{key} {short(value)}")
            if key in self.distortion and not zeros(value):
                found = [DISTORTED]
            if key not in self._applied and not self.noted.get(key, absent)(value):
                unused.setdefault(key, f"{key} {short(value)}")
        if unused:
            settings = ", ".join(unused.values())
            found.append(f"{path.name} has settings that are not applied: {settings}")
        return tuple(found)

    @property
    def _applied(self) -> frozenset[str]:
        return self.used | self.harmless | self.distortion | frozenset(self.required)


def _entries(said: Iterable[Mapping[str, Any]]) -> Iterable[tuple[str, Any]]:
    """All keys and values that are not null."""
    for mapping in said:
        for key, value in mapping.items():
            if value is not None:
                yield str(key), value


def short(value: object) -> str:
    """The value as one line of at most 40 characters."""
    text = " ".join(str(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."


def numbers_of(value: Any) -> np.ndarray | None:
    """The numbers in a value, in lists of any depth, as (n,); None if there is anything else."""
    parts = list(value.values()) if isinstance(value, dict) else value
    try:
        return np.asarray(parts, float).ravel()
    except (TypeError, ValueError, OverflowError):
        return None


def as_list(value: Any) -> list[Any]:
    """A list as it is, any other value as the only one of a list."""
    return value if isinstance(value, list) else [value]


def zeros(value: Any) -> bool:
    """Whether a value contains nothing but zeros, or false."""
    numbers = numbers_of(value)
    return numbers is not None and not numbers.any()


def one(value: Any) -> bool:
    """Whether a value contains nothing but ones."""
    numbers = numbers_of(value)
    return numbers is not None and bool((numbers == 1).all())


def identity(value: Any) -> bool:
    """Whether a value is the matrix of the identity, 3 x 4 or 4 x 4."""
    numbers = numbers_of(value)
    if numbers is None or len(numbers) not in (12, 16):
        return False
    return bool(np.abs(numbers - np.eye(4).ravel()[: len(numbers)]).max() < _SAME)


def absent(value: Any) -> bool:
    """False: the key alone has an effect, or is not known."""
    return False


def any_of(*words: str) -> Neutral:
    """Whether a value is one of the words, which are in lower case."""

    def check(value: Any) -> bool:
        return str(value).strip().lower() in words

    return check


@dataclass(frozen=True)
class SequenceCamera:
    """The pinhole camera, and the depth units per metre. assumed: no file contains the camera.
    colour: the camera of the colour images if it differs; it has the same pose. notes: a sentence
    for everything in its file that is not applied, such as a lens distortion.
    """

    pinhole: PinholeCamera
    depth_units_per_metre: float = UNITS_PER_METRE
    assumed: bool = False
    colour: PinholeCamera | None = None
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict:
        """The content of camera.json."""
        return self.pinhole.to_dict() | {"depth_units_per_metre": self.depth_units_per_metre}


def camera_file(folder: Path) -> SequenceCamera | None:
    """The camera in the folder's camera.json, which we write in several formats.

    None if there is no such file.
    """
    if not (folder / CAMERA).is_file():
        return None
    with within(folder / CAMERA):
        return _camera_of(read_json(folder / CAMERA))


def _camera_of(settings: dict) -> SequenceCamera:
    """The camera of the content of camera.json, to which others may have added a distortion."""
    coefficients = {name: settings.pop(name) for name in COEFFICIENTS if name in settings}
    notes = Keys(used=names(""), distortion=COEFFICIENTS).notes([coefficients], Path(CAMERA))
    units = settings.pop("depth_units_per_metre", UNITS_PER_METRE)
    if isinstance(units, bool) or not isinstance(units, int | float):
        raise InputError("depth_units_per_metre as a number", found=units)
    needed = [field.name for field in fields(PinholeCamera)]
    missing = [name for name in needed if name not in settings]
    if missing:  # the defaults are those of another camera
        raise InputError(f"a camera with {', '.join(needed)}", found=f"no {', '.join(missing)}")
    return SequenceCamera(PinholeCamera.from_dict(settings), check_units(units), notes=notes)


def pinhole_of(image: Path, fx: float, fy: float, cx: float, cy: float) -> PinholeCamera:
    """The camera with an image's size.

    In the original files fy < 0, which means that y points up.
    """
    header = image_header(image)
    return PinholeCamera(header.width, header.height, fx, abs(fy), cx, cy)


def pinhole_of_matrix(image: Path, path: Path, matrix: np.ndarray) -> PinholeCamera:
    """The camera with an image's size and the camera matrix (3, 3) or (4, 4) of a file.

    Raises InputError for a matrix with skew, or another last row or column.
    """
    rest = matrix.copy()
    for place in ((0, 0), (1, 1), (0, 2), (1, 2)):
        rest[place] = 0
    rest -= np.diag([0.0, 0.0, 1.0, 1.0][: len(matrix)])
    if np.abs(rest).max() > 1e-6:
        expected = "a camera matrix fx 0 cx, 0 fy cy, 0 0 1"
        raise InputError(expected, path=path, found=" ".join(f"{v:g}" for v in matrix.ravel()))
    (fx, _, cx), (_, fy, cy) = matrix[:2, :3].tolist()
    return pinhole_of(image, fx, fy, cx, cy)


def settings_in(path: Path) -> dict[str, list[str]]:
    """The words of lines `key = words`, as in ScanNet's and BundleFusion's files."""
    said = {}
    for _, line in data_lines(read_text(path)):
        key, _, value = line.partition("=")
        said[key.strip()] = value.split()
    return said


def numbers_in(path: Path, values: list[str], count: int, what: str) -> list[float]:
    """Convert `count` values to finite numbers. Raises InputError with the file's name."""
    try:
        numbers = [float(value) for value in values]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(what, path=path, found=" ".join(map(str, values))[:80] or "nothing")
    return numbers


def pose_of(value: Any, path: Path) -> SE3:
    """The pose in a 4 x 4 matrix, which may be a mapping with `data`; the identity for None.

    Raises InputError for anything else.
    """
    if value is None:
        return SE3.identity()
    if isinstance(value, dict):
        value = value.get("data")
    numbers = numbers_of(value)
    if numbers is None or len(numbers) != 16 or not np.isfinite(numbers).all():
        expected = "T_BS with the 16 numbers of a 4 x 4 matrix"
        raise InputError(expected, path=path, found=short(value))
    with within(path):
        return SE3.from_matrix(numbers.reshape(4, 4))


def mount_of(T_truth_camera: SE3) -> SE3 | None:
    """The pose of the camera in the frame that the ground truth follows; None for the identity, but
    for rounding.
    """
    same = np.abs(T_truth_camera.matrix - np.eye(4)).max() < _SAME
    return None if same else T_truth_camera


def mount_notes(T_truth_camera: SE3 | None, key: str = "T_BS") -> tuple[str, ...]:
    """A sentence if the ground truth follows another frame than the camera's; key: where the file
    says so.
    """
    if T_truth_camera is None:
        return ()
    distance_mm = 1000 * float(np.linalg.norm(T_truth_camera.translation))
    applied = f"{key} is applied: the ground truth follows a body"
    return (f"{applied}, and the camera is {distance_mm:.3g} mm from its origin",)
