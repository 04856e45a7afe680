"""`iclnuim table 1`: Table I of the paper from the shipped trajectory files: frames, length, mean speed, beside the printed figures."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

from iclnuim import shipped
from iclnuim.formats.files import read_json
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.trajectory import FRAME_RATE_HZ

from ..console import Console
from ..options import common

PRINTED = Path(__file__).parents[1] / "benchmark/paper_table_1.json"


def configure(parser: argparse.ArgumentParser) -> None:
    numbers = "1: frames, lengths and speeds of the trajectories"
    parser.add_argument("number", type=int, choices=(1,), metavar="N", help=numbers)
    common(parser, "iclnuim table 1")


def run(args: argparse.Namespace, console: Console) -> int:
    table = rows()
    console.result({row.sequence: asdict(row) for row in table}, text(table))
    return 0


@dataclass(frozen=True)
class Row:
    """One trajectory. Lengths in m, speeds in m/s.

    The printed speeds are not length x 30 / frames: they imply a duration of printed length / printed speed, and
    `speed_for_printed_duration_m_s` is our length over that duration.
    """

    sequence: str
    frames: int
    length_m: float
    speed_at_30_hz_m_s: float
    printed_duration_s: float
    speed_for_printed_duration_m_s: float
    printed_frames: int
    printed_length_m: float
    printed_speed_m_s: float


def rows() -> list[Row]:
    """The eight shipped trajectories in the paper's order."""
    printed = read_json(PRINTED)
    return [_row(f"{scene}/kt{k}", k, printed[scene]) for scene in ("living_room", "office") for k in range(4)]


def _row(sequence: str, column: int, printed: dict) -> Row:
    frames, length_m, speed = (printed[key][column] for key in ("frames", "length_m", "mean_speed_m_s"))
    trajectory = read_trajectory(shipped.trajectory_file(sequence)).trajectory
    ours_m = trajectory.length_m()
    return Row(
        sequence=sequence,
        frames=len(trajectory),
        length_m=ours_m,
        speed_at_30_hz_m_s=ours_m * FRAME_RATE_HZ / (len(trajectory) - 1),
        printed_duration_s=length_m / speed,
        speed_for_printed_duration_m_s=ours_m * speed / length_m,
        printed_frames=frames,
        printed_length_m=length_m,
        printed_speed_m_s=speed,
    )


def text(table: list[Row]) -> str:
    """The table as plain text."""
    lines = [
        "                 ours                                          printed in the paper",
        "sequence         frames  length m  m/s at 30 Hz  m/s for T     frames  length m   m/s    T = length / speed",
    ]
    lines += [
        f"{r.sequence:<16} {r.frames:>6}  {r.length_m:>8.3f}  {r.speed_at_30_hz_m_s:>12.3f}  {r.speed_for_printed_duration_m_s:>9.3f}"
        f"     {r.printed_frames:>6}  {r.printed_length_m:>8.2f}  {r.printed_speed_m_s:.3f}  {r.printed_duration_s:>6.1f} s"
        for r in table
    ]
    return "\n".join(lines)
