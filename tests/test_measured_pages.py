"""tools/measured.py: every mark is in its page once, every command is understood, and what commands
print becomes tables.
"""

import re
import shlex

import pytest
from iclnuim.headless import cli
from iclnuim.tools import measured
from iclnuim.tools.measured import MEASURED, replaced


def test_every_marked_table_has_its_command_and_every_command_its_marked_table(repository):
    pages = {
        page: page.read_text()
        for page in (*(repository / "docs").rglob("*.md"), repository / "README.md")
    }
    marks = [
        (p.relative_to(repository).as_posix(), m)
        for p, t in pages.items()
        for m in re.findall("<!-- measured: (.*) -->", t)
    ]
    assert sorted(marks) == sorted((m.page, m.mark) for m in MEASURED)
    for one in MEASURED:
        text = pages[repository / one.page]
        assert replaced(text, one, "| new |\n").count("| new |") == 1
        with pytest.raises(ValueError, match="once"):
            replaced(text + one.begin + one.end, one, "")


@pytest.mark.parametrize("words", sorted({command for one in MEASURED for command in one.commands}))
def test_its_commands_are_understood(words):
    command, *rest = shlex.split(words)
    assert cli.parsed(command, [*rest, "--json"]).json


LEVEL = dict.fromkeys(
    ("triangles", "build_s", "mean_m", "p99_m", "off_share", "frame_s", "median_of_255"), 1.0
)
LEVELS = [{**LEVEL, "detail": 1.0, "psnr_db": 40.0}, {**LEVEL, "detail": 2.0, "psnr_db": None}]
MAP = {"size": 512, "bake_s": 9.0, "frame_s": 0.1, "psnr_db": None, "median_of_255": None}
RUN = {"odometer": "icp", "ms_median": 12.0, "ms_95": 15.0, "ate_rmse_m": 0.0123, "coverage": 0.99}
PAIR = {
    "depth": "none",
    "rgb": "none",
    "frames_per_s": 57.0,
    "ratio": 1.1,
    "cpu_ms": 66.0,
    "cpu_ratio": 1.1,
}
DAMAGE = {"frames": 9, "kills": 3, "broken": 0, "lost": 0, "twice": 0, "events": {"full": 1}}
UNSEEN = {"room": "office", "poses": 79, "triangles": 0.5, "surface": 0.4, "texels": None}
ERROR = {"psnr_db": [40.0, 36.0], "median": 0.0028}
GROUP = {
    "succeeded": 0.5,
    "false_successes": 0.1,
    "false_alarms": 0.0,
    "ate_m": 0.001,
    "nees": None,
}
STEP = {
    "method": "icp",
    "sequence": "kt2/clean",
    "frames": 9,
    "processed": 9,
    "tracked": 9,
    "ate_m": 0.001,
    "ms": 9.0,
}
STEPS = [{**STEP, "value": value} for value in (0.0, 0.02, 1.0, 30.0, 640.0)]
VOXEL = {
    "sequence": "kt2/clean",
    "voxel_m": 0.01,
    "mean_m": 0.001,
    "p95_m": 0.002,
    "ms": 9.0,
    "memory_mb": 90.0,
}
CHANGE = {
    "sequence": "kt2",
    "kind": "clean",
    "method": "icp",
    "levels": [0.5, 1],
    "ate_m": [None, 1e-3],
    "spread": None,
}
BUILD = {"sequence": "kt2", "seed": 0, "detail": 1.0, "triangles": 1000, "surface_m": 0.001}
TABLE = {
    "columns": ["odometer", "error mm", "kt0"],
    "rows": [["ICP", "RMSE", "1.0"], ["", "Mean", "0.9"]],
}
BENCHMARK_TABLES = [
    m.mark.removeprefix("benchmark-").replace("-", "_")
    for m in MEASURED
    if m.page == "docs/measured/benchmark.md"
]
#: What a command prints, as far as it is used, by the command's first words.
PRINTED = {
    "bench render": {
        "methods": [
            {
                "method": {"family": "baked", "label": "1"},
                "seconds": 0.1,
                "error": ERROR,
                "flicker": 0.004,
            }
        ]
    },
    "bench textures": {
        "rows": [
            {
                "sequence": "living_room/kt2",
                "textures": "mipmaps",
                "ms": 90.0,
                "change_median": 0.001,
                "change_mean": 0.003,
            }
            | {"difference": difference}
            for difference in (0.004, None)
        ]
    },
    "bench detail-odometry": {"changes": [CHANGE], "builds": [BUILD]},
    "bench detail": {
        "levels": dict.fromkeys(("living_room", "office"), LEVELS),
        "knee": dict.fromkeys(("living_room", "office"), 1.0),
        "maps": {"office": [MAP, {**MAP, "psnr_db": 41.0, "median_of_255": 0.3}]},
        "unseen": [UNSEEN],
    },
    "bench curve voxel": {"points": [VOXEL]},
    "bench curve": {"points": STEPS},
    "bench odometry": {
        "results": [{"sequence": "kt2/clean", "runs": [RUN]}, {"sequence": "kt2/noisy", "runs": []}]
    },
    "bench farm": {
        "splits": [
            {
                "light": "path",
                "workers": 1,
                "threads": 2,
                "frames_an_hour": 905.0,
                "busy_share": 1.0,
            }
        ]
    },
    "bench chaos": {"this farm": DAMAGE, "plain Blender": {**DAMAGE, "events": {}}},
    "bench noise": {
        "pairs": [PAIR],
        "model_ms": {"depth": {"paper": 12.9}},
        "overlap_with_official": None,
    },
    "fuse out": {"memory_mb": 280.0, "parts_that_left": 0},
    "evaluate surface": {
        "distance_m": dict.fromkeys(("mean", "median", "std", "min", "max"), 0.0005)
    },
    "odometry ": {"runs": [RUN]},
    "run ": {},
    "stress ": {
        "cells": [
            {**GROUP, "method": method, "perturbation": name, "severity": severity}
            for method in ("icp", "baseline:opencv-icp")
            for name, severity in (("clean", 0), ("holes", 1), ("holes", 2))
        ]
    },
    "benchmark": {"tables": {name: TABLE for name in BENCHMARK_TABLES}},
}


@pytest.mark.parametrize("one", MEASURED, ids=lambda one: one.mark)
def test_what_the_commands_print_becomes_rows_of_the_same_length(one):
    found = [
        next(value for words, value in PRINTED.items() if command.startswith(words))
        for command in one.commands
    ]
    rows = one.text(found).splitlines()
    assert len(rows) >= 3 and len({row.count("|") for row in rows}) == 1


def test_what_is_kept_is_not_measured_again_and_becomes_the_table(tmp_path, monkeypatch):
    page = tmp_path / "docs/measured/farm.md"
    page.parent.mkdir(parents=True)
    page.write_text(
        "before\n<!-- measured: farm-splits -->\nold\n<!-- end of farm-splits -->\nafter\n"
    )
    monkeypatch.setattr(measured, "TOP", tmp_path)
    split = {
        "light": "baked",
        "workers": 2,
        "threads": 2,
        "frames_an_hour": 27460.2,
        "busy_share": 0.914,
    }
    monkeypatch.setattr(measured, "output_of", lambda command, keep, programs: {"splits": [split]})
    assert measured.main(["--only", "farm-splits"]) == 0
    assert page.read_text().splitlines()[3] == "| --- | --- | --- | --- | --- |"
    assert (
        "\n| 2 x 2 | 27,460 | 91% |  |  |\n<!-- end of farm-splits -->\nafter\n" in page.read_text()
    )


def test_steps_of_a_curve_are_relative_to_the_default_step_as_geometric_means():
    def step(sequence, value, ate_mm, ms, processed=10, tracked=10):
        figures = {
            "frames": 10,
            "processed": processed,
            "tracked": tracked,
            "ate_m": 1e-3 * ate_mm,
            "ms": ms,
        }
        return {"method": "icp", "sequence": sequence, "value": value, **figures}

    points = [step("a", 1.0, 2.0, 10.0), step("a", 2.0, 2.0, 5.0), step("a", 4.0, 1.0, 10.0, 5, 5)]
    points += [
        step("b", 1.0, 1.0, 10.0),
        step("b", 2.0, 4.0, 20.0),
        step("b", 4.0, 1.0, 10.0, 10, 4),
    ]
    points += [{**points[0], "method": "fovis", "value": None}]
    rows = measured._curve(1.0)([{"points": points}]).splitlines()
    assert rows[0] == "|  | icp |"  # a method without the setting has no column
    assert rows[2:] == ["| 1 | 1.00, 1.00 |", "| 2 | 2.00, 1.00 |", "| 4 | fails on 1 |"]
    points[-2]["tracked"] = 10
    assert measured._curve(1.0)([{"points": points}]).splitlines()[-1] == "| 4 | 0.71, 1.00 (75%) |"


def test_programs_of_systems_are_passed_to_the_commands_that_use_them():
    """Commands without a system get no option; a system that has the name of an odometer is not
    confused with it.
    """
    programs = ["orbslam3=/opt/orb/bin/python", "dvo=/opt/dvo_tum"]
    options = measured._program_options
    assert options("run orbslam3 --runs 3 out/kt2/clean", programs) == [
        "--program",
        "/opt/orb/bin/python",
    ]
    assert (
        options("run rtabmap out/kt2/clean", programs)
        == options("odometry dvo out/kt2/clean", programs)
        == []
    )
    stress = options("stress out/kt2/clean --system orbslam3", programs)
    assert stress == ["--set", "orbslam3.program=/opt/orb/bin/python"]


def test_a_command_that_fails_ends_the_measurement_in_a_line(capfd):
    with pytest.raises(SystemExit, match="measured: iclnuim evaluate ended with exit code 2"):
        measured.output_of("evaluate no/such/file no/such/other", None)
    assert "Traceback" not in capfd.readouterr().err
