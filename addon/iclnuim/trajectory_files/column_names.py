"""The names that programs give to the columns of a trajectory: one table of synonyms.

Names are compared in lower case, with `_` for every other sign, and without their unit: `p_RS_R_x
[m]`, `field.pose.position.x`, `pos_x`, `tx` and `positionX` all name x.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

#: Words of a stamp's unit: ticks per second; of a position's unit: metres.
_TICKS = (
    dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0)
    | dict.fromkeys(("ms", "msec", "msecs", "milliseconds"), 1e3)
    | dict.fromkeys(("us", "µs", "usec", "usecs", "microseconds"), 1e6)
    | dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"), 1e9)
)
_METRES = {"m": 1.0, "metres": 1.0, "meters": 1.0, "cm": 0.01, "mm": 0.001}

_BEFORE = "(?:(?:field|msg|data|header|pose|point|transform|camera|cam|gt|est)_)*"
_FRAME = "(?:[a-z]{1,2}|world|map|odom|camera|cam|body|imu|device|odometry)"
_POSITION = "(?:position|pos|translation|trans|location|loc|p|t)"
_QUATERNION = "(?:quaternion|quat|orientation|rotation|rot|q|r)"


def _along(stem: str, axis: str) -> str:
    """The pattern of an axis of a vector, with the frames that it may name: t_x, p_RS_R_x,
    p_G_Ix.
    """
    return f"(?:{_BEFORE}{stem}_?(?:{_FRAME}_|{_FRAME}_[a-z](?={axis}))*{axis}(?:_{_FRAME})*)"


_POSITIONS = ("x", "y", "z")
_QUATERNIONS = ("qx", "qy", "qz", "qw")
_ENTRIES = tuple(["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22"])
#: Quantity -> the pattern of its names. Whole nanoseconds are those beside whole seconds.
_SYNONYMS = {
    "stamp": r"\w*(?:time|stamp)s?|t|ts|(?:\w*stamp_|)(?:secs?|seconds)",
    "nanoseconds": r"(?:\w*stamp_|)(?:nsecs?|nanosecs?|nanoseconds)",
    "frame": r"(?:\w+_)?(?:frame|id|idx|index|seq)(?:_id|_number)?",
    "x": f"{_along(_POSITION, 'x')}|{_BEFORE}x|\\w+_position_x|easting|[mrt]03",
    "y": f"{_along(_POSITION, 'y')}|{_BEFORE}y|\\w+_position_y|northing|[mrt]13",
    "z": f"{_along(_POSITION, 'z')}|{_BEFORE}z|\\w+_position_z|altitude|height|elevation|[mrt]23",
    **{q: f"{_along(_QUATERNION, q[1])}|\\w+_orientation_{q[1]}" for q in _QUATERNIONS},
    **{entry: f"[mrt]{entry[1:]}" for entry in _ENTRIES},
    "angle": rf"{_BEFORE}(?:theta|yaw|heading|psi|phi)",
}
#: What a header names: positions, or a position and a direction in the plane.
_IN_THE_PLANE = {"x", "y", "angle"}


@dataclass(frozen=True)
class NamedColumns:
    """The columns that names give, from 0: stamp or frame number (None without one), whole
    nanoseconds beside whole seconds, x y z, and qx qy qz qw or r00 ... r22 or nothing.

    ticks, metres: the unit of stamps (per second) and of positions, None if no name gives it.
    others: the names of all other columns.
    """

    stamp: int | None
    nanoseconds: int | None
    position: tuple[int, ...]
    orientation: tuple[int, ...]
    is_frame: bool
    ticks: float | None
    metres: float | None
    others: tuple[str, ...]

    @property
    def used(self) -> tuple[int, ...]:
        """The columns in the order stamp, nanoseconds, position, orientation."""
        first = (column for column in (self.stamp, self.nanoseconds) if column is not None)
        return (*first, *self.position, *self.orientation)


def names_in(line: str) -> list[str]:
    """The names of columns in a line that names x, y and z, or x, y and an angle, else []; words
    before the first colon are none.
    """
    text = line.strip().lstrip("#% ").rstrip(",;")
    for part in (text.partition(":")[2], text):
        for delimiter in (",", ";", "\t", None):
            names = part.split(delimiter) if delimiter else _parted_by_blanks(part)
            found = set(map(_quantity, names))
            if set(_POSITIONS) <= found or found >= _IN_THE_PLANE:
                return [name.strip(" \"'") for name in names]
    return []


def columns_of(names: Sequence[str]) -> NamedColumns | None:
    """The columns that names give; None if x, y and z are not each named once."""
    found: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        found.setdefault(_quantity(name), []).append(column)
    position = _each_once(found, _POSITIONS)
    if not position:
        return None
    orientation = _each_once(found, _QUATERNIONS) or _each_once(found, _ENTRIES)
    stamps = sorted(found.get("stamp", []), key=lambda column: "stamp" not in names[column].lower())
    stamp = (*stamps, *found.get("frame", []), None)[0]
    whole = found.get("nanoseconds", []) if stamps else []
    used = {stamp, *whole[:1], *position, *orientation}
    return NamedColumns(
        stamp=stamp,
        nanoseconds=(*whole, None)[0],
        position=position,
        orientation=orientation,
        is_frame=not stamps,
        ticks=None if stamp is None else _unit(names[stamp], _TICKS),
        metres=_unit(names[position[0]], _METRES),
        others=tuple(name for column, name in enumerate(names) if column not in used),
    )


def in_the_plane(names: Sequence[str]) -> bool:
    """Whether the names are those of positions and angles in the plane, without a height."""
    found = set(map(_quantity, names))
    return found >= _IN_THE_PLANE and "z" not in found


def is_known(name: str) -> bool:
    """Whether a name is one of a stamp, a frame number, a position or a rotation."""
    return bool(_quantity(name))


def _each_once(found: dict[str, list[int]], quantities: Sequence[str]) -> tuple[int, ...]:
    """The columns of the quantities, () unless each is named once."""
    columns = [found.get(quantity, []) for quantity in quantities]
    if any(len(ones) != 1 for ones in columns):
        return ()
    return tuple(ones[0] for ones in columns)


def _parted_by_blanks(text: str) -> list[str]:
    """Names parted by blanks, each with its unit in brackets."""
    joined = re.sub(r"\s*([\[(])\s*(\S*?)\s*([\])])", r"\1\2\3", text)
    return [name.rstrip(",;:") for name in joined.split()]


def _plain(name: str) -> str:
    """A name in lower case, with `_` for other signs, without a unit in brackets."""
    text = re.sub(r"[\[(].*?[\])]", "", name.lower())
    return re.sub(r"[^a-z0-9µ]+", "_", text).strip("_")


def _quantity(name: str) -> str:
    """The quantity of a name, with or without a unit as its last word; "" if no pattern fits."""
    plain = _plain(name)
    stem, _, word = plain.rpartition("_")
    forms = [plain]
    if word in _TICKS or word in _METRES:
        forms.append(stem)
    for form in forms:
        for quantity, pattern in _SYNONYMS.items():
            if re.fullmatch(pattern, form):
                return quantity
    return ""


def _unit(name: str, units: dict[str, float]) -> float | None:
    """The unit of a name, in brackets or as its last word; None without one."""
    bracket = re.search(r"[\[(]\s*(.*?)\s*[\])]", name.lower())
    word = bracket[1] if bracket else _plain(name).rpartition("_")[2]
    return units.get(word)
