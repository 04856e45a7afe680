"""`iclnuim table 1`: Table I of the paper from the shipped trajectory files: frames, length, mean speed, beside the printed figures."""

import argparse
from itertools import product
from pathlib import Path

from iclnuim import shipped
from iclnuim.formats.files import read_json
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry.trajectory import FRAME_RATE_HZ

from ..options import Console, common

PRINTED = Path(__file__).parents[1] / "benchmark/paper_table_1.json"


def configure(parser: argparse.ArgumentParser) -> None:
    numbers = "1: frames, lengths and speeds of the trajectories"
    parser.add_argument("number", type=int, choices=(1,), metavar="N", help=numbers)
    common(parser, "iclnuim table 1")


def run(args: argparse.Namespace, console: Console) -> None:
    table = rows()
    lines = [
        "                 ours                                          printed in the paper",
        "sequence         frames  length m  m/s at 30 Hz  m/s for T     frames  length m   m/s    T = length / speed",
    ]
    line = (
        "{sequence:<16} {frames:>6}  {length_m:>8.3f}  {speed_at_30_hz_m_s:>12.3f}  {speed_for_printed_duration_m_s:>9.3f}"
        "     {printed_frames:>6}  {printed_length_m:>8.2f}  {printed_speed_m_s:.3f}  {printed_duration_s:>6.1f} s"
    )
    console.result({row["sequence"]: row for row in table}, "\n".join([*lines, *(line.format(**r) for r in table)]))


def rows() -> list[dict]:
    """The eight shipped trajectories in the paper's order. Lengths in m, speeds in m/s.

    The printed speeds are not length x 30 / frames: they imply a duration of printed length / printed speed, and
    `speed_for_printed_duration_m_s` is our length over that duration.
    """
    printed, table = read_json(PRINTED), []
    for scene, k in product(("living_room", "office"), range(4)):
        frames, length_m, speed_m_s = (printed[scene][key][k] for key in ("frames", "length_m", "mean_speed_m_s"))
        trajectory = read_trajectory(shipped.trajectory_file(f"{scene}/kt{k}")).trajectory
        ours_m = trajectory.length_m()
        row = {
            "sequence": f"{scene}/kt{k}",
            "frames": len(trajectory),
            "length_m": ours_m,
            "speed_at_30_hz_m_s": ours_m * FRAME_RATE_HZ / (len(trajectory) - 1),
            "printed_duration_s": length_m / speed_m_s,
            "speed_for_printed_duration_m_s": ours_m * speed_m_s / length_m,
            "printed_frames": frames,
            "printed_length_m": length_m,
            "printed_speed_m_s": speed_m_s,
        }
        table.append(row)
    return table
