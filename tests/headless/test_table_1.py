"""`iclnuim table 1`: the paper's Table I from the shipped files."""

import json

import pytest
from iclnuim.benchmark.experiments.recipes.paper.tables import trajectory_rows
from iclnuim.headless import cli


def test_frames_and_lengths_are_the_papers_and_so_are_speeds_over_its_durations():
    rows = trajectory_rows()
    assert [r["sequence"] for r in rows] == [
        f"{room}/kt{k}" for room in ("living_room", "office") for k in range(4)
    ]
    for r in rows:  # length and speed as printed, to their last digit
        assert r["frames"] == r["printed_frames"], r["sequence"]
        assert abs(r["length_m"] - r["printed_length_m"]) < 0.0051, r["sequence"]
        assert abs(r["speed_for_printed_duration_m_s"] - r["printed_speed_m_s"]) < 0.00051, r[
            "sequence"
        ]


def test_at_30_hz_the_printed_speeds_do_not_follow_from_length_and_frames():
    for row in trajectory_rows():
        assert row["speed_at_30_hz_m_s"] == pytest.approx(
            row["length_m"] * 30 / (row["frames"] - 1)
        )
        assert row["speed_at_30_hz_m_s"] > 1.01 * row["printed_speed_m_s"]
    durations = [r["printed_duration_s"] for r in trajectory_rows()[:4]]
    assert durations == pytest.approx([51.9, 32.5, 29.9, 43.0], abs=0.1)


def test_the_command_prints_a_row_a_trajectory(capsys):
    assert cli.main(["table", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:]] == [r["sequence"] for r in trajectory_rows()]
    assert cli.main(["table", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["office/kt2"]["printed_length_m"] == 9.02
