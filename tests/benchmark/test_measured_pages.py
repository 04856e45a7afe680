"""tools/measured.py: pages say what the cells hold and nothing else, every command is understood,
and what commands print becomes tables.
"""

import json
import re
import shlex
from collections import Counter
from dataclasses import replace

import pytest

pytest.importorskip("numba")
from iclnuim.benchmark.experiments.cell import Cell, Measured  # noqa: E402
from iclnuim.benchmark.experiments.outcome import Outcome  # noqa: E402
from iclnuim.benchmark.experiments.recipes.paper.keys import (  # noqa: E402
    PaperKey,
    all_keys,
    paper_odometers,
)
from iclnuim.benchmark.experiments.recipes.paper.recipe import KIND, code_of_trajectory  # noqa: E402
from iclnuim.benchmark.experiments.recipes.stress.recipe import KIND as STRESS  # noqa: E402
from iclnuim.benchmark.experiments.recipes.stress.recipe import (  # noqa: E402
    StressKey,
    system_name,
)
from iclnuim.benchmark.experiments.store import Store  # noqa: E402
from iclnuim.benchmark.odometry.registry import BASELINES, ODOMETERS  # noqa: E402
from iclnuim.benchmark.perturbations.plan import BASES, NOISY  # noqa: E402
from iclnuim.benchmark.systems.system import built_in  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.headless import cli  # noqa: E402
from iclnuim.tools import measured, measured_tables  # noqa: E402
from iclnuim.tools.measured_cells import (  # noqa: E402
    PublishedCell,
    PublishedCells,
    Run,
    code_hash,
)
from iclnuim.tools.measured_drawn import DRAWN  # noqa: E402
from iclnuim.tools.measured_tables import COMMAND_TABLES  # noqa: E402
from made_up import only, result, written  # noqa: E402

#: Pages of what no command of ours measures.
BY_HAND = ("formats.md",)
#: A number with a unit of something measured.
FIGURE = re.compile(
    r"[0-9.]\s?(?:mm|cm|m|ms|s|min|h|%|dB|GB|MB|KB|degrees|times|frames a second|core-\w+)\b"
)
MEASURED_RUN = Run("75405c27", "2 cores", "iclnuim benchmark")


@pytest.fixture(scope="module")
def cells():
    return PublishedCells.read(measured.TOP / measured.CELLS)


def page_texts():
    return {page.name: page.read_text() for page in measured.pages()}


@pytest.mark.parametrize("name", sorted(page_texts()))
def test_a_page_says_what_the_cells_hold(name, cells):
    text = page_texts()[name]
    assert measured.redrawn(text, cells) == text


@pytest.mark.parametrize("name", sorted(set(page_texts()) - set(BY_HAND)))
def test_no_figure_stands_outside_of_what_is_drawn(name):
    prose = measured._MARKED.sub("", page_texts()[name])
    prose = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", "", prose, flags=re.S)
    assert FIGURE.findall(prose) == []


def test_a_changed_cell_changes_its_page_and_only_what_shows_it(cells):
    key = (KIND, "office", "kt3", "noisy", "rgbd", "best", "default", 0, 0)
    text = page_texts()["odometry.md"]
    before = cells.cells[key]
    other = PublishedCells(dict(cells.cells))
    other.cells[key] = replace(before, figures={"ate_m": {"rmse": 0.98765}})
    changed = measured.redrawn(text, other)
    lines = [line for line in changed.splitlines() if line not in text.splitlines()]
    assert len(lines) == 1 and lines[0].startswith("| office kt3 noisy | ") and " 988 " in lines[0]


def test_a_figure_that_no_cell_holds_is_not_measured(cells):
    marks = re.findall("<!-- measured: (.*) -->", "".join(page_texts().values()))
    nothing = PublishedCells()
    for mark in ("odometry-cost", "light", "benchmark-verdicts"):
        assert mark in marks and "not measured" in measured.drawn(mark, nothing)
    with pytest.raises(ValueError, match="nothing draws odometry-ates"):
        measured.drawn("odometry-ates", cells)


def test_errors_over_the_noise_seeds_are_of_all_that_are_measured():
    def row(ate_m):
        key = {"odometer": "dvo", "reference": "default", "noise": "noisy", "trajectory": "kt1"}
        keys = only([result(k, 0.01) for k in all_keys(seeds=range(3))], room="office", **key)
        cells = PublishedCells()
        found = [result(r.key, m) for r, m in zip(keys, ate_m, strict=True)]
        cells.add([replace(r, identity={"input": "a"}) for r in found], KIND, MEASURED_RUN)
        header, *rows = DRAWN["benchmark-seeds"](cells)
        by_sequence = {of[0]: dict(zip(header, of, strict=True)) for of in rows}
        return by_sequence["office kt1 noisy"]

    assert row([0.003, 0.001, 0.002])["dvo"] == "2 (1 to 3)"
    assert row([0.003, 0.001, 0.002])["seeds"] == "0 to 3"  # the others have none


def test_authors_programs_stand_below_their_methods_and_lost_frames_beside_the_error():
    place = ("living_room", "kt0", "clean")
    program = PaperKey(*place, "dvo_core", "final", "run", run=1)
    found = [
        result(PaperKey(*place, "dvo", "paper", "default"), 0.03, coverage=0.94),
        result(program, 1.04, coverage=1.0),
        result(PaperKey(*place, "icp", "paper", "model"), 0.12, coverage=0.999),
        result(PaperKey(*place, "icp", "paper", "model-ahead"), 0.001, coverage=1.0),
    ]
    cells = PublishedCells()
    cells.add([replace(r, identity={"input": "a"}) for r in found], KIND, MEASURED_RUN)
    rows = DRAWN["benchmark-paper"](cells)[1:]
    assert [row[1:3] for row in rows] == [
        ["dvo", "30 (94 %)"],
        ["dvo_core", "1,040"],
        ["icp", "120"],
        ["icp, window ahead", "1"],
    ]
    assert rows[0][3] == rows[1][3] == "113.8" and rows[2][3] == rows[3][3] == "118.8"
    assert {row[4] for row in rows} == {"not measured"}


def test_a_surface_of_a_model_with_its_window_ahead_has_a_row_and_others_have_none_twice():
    place = ("living_room", "kt1", "clean")
    found = [
        result(PaperKey(*place, "dvo", "paper", "default"), 0.03, 0.004),
        result(PaperKey(*place, "icp", "paper", "model"), 0.02, 0.002),
        result(PaperKey(*place, "icp", "paper", "model-ahead"), 0.01, 0.001),
    ]
    cells = PublishedCells()
    cells.add([replace(r, identity={"input": "a"}) for r in found], KIND, MEASURED_RUN)
    rows = DRAWN["benchmark-surfaces"](cells)[1:]
    assert [(row[1], row[4]) for row in rows] == [
        ("dvo, paper", "4"),
        ("icp, paper", "2"),
        ("icp, paper, window ahead", "1"),
    ]


def test_a_first_failure_names_the_higher_severities_without_one():
    key = StressKey("office/kt1", 80, "holes", 0, "icp")
    found = []
    for severity, success in enumerate((True, False, True, False, True), 1):
        outcome = Outcome(120, 1.0, 0.01, success).to_dict()
        found.append(Measured(replace(key, severity=severity), {"input": "a"}, outcome))
    some = PublishedCells()
    some.add(found, STRESS, MEASURED_RUN)
    header, row = DRAWN["stress-fails"](some)
    assert dict(zip(header, row, strict=True))["icp"] == "2, not 3, 5"


def test_a_key_stays_when_a_method_is_renamed(cells):
    of_others = {key.method for key in cells.stress()} - {*ODOMETERS}
    assert of_others < {*BASELINES, *map(system_name, built_in())}
    words = [key for key in cells.cells if key[0] == STRESS and key[5] == "baseline:opencv-icp"]
    (one,) = [key for key in cells.stress() if key.words == (*words[0][1:5], "opencv-icp", "")]
    again = PublishedCells()
    measured_again = result(PaperKey("office", "kt0", "clean", "dvo_core", "final", "run"), 0.01)
    for some, kind in ((replace(measured_again, key=one), STRESS), (measured_again, KIND)):
        again.add([replace(some, identity={"input": "a"})], kind, MEASURED_RUN)
    assert words[0] in again.cells and one not in again.cells
    assert (KIND, "office", "kt0", "clean", "DVO (dvo_core)", "final", "run", 0, 0) in again.cells


def test_every_table_stands_on_one_page():
    marks = re.findall("<!-- measured: (.*) -->", "".join(page_texts().values()))
    assert len(marks) == len(set(marks))
    assert {*DRAWN, *COMMAND_TABLES} <= set(marks)


def test_cells_keep_their_bytes_and_a_line_that_is_none_is_named(cells, tmp_path):
    path = measured.TOP / measured.CELLS
    cells.write(tmp_path / "again.jsonl")
    assert (tmp_path / "again.jsonl").read_bytes() == path.read_bytes()
    assert path.stat().st_size < 2_000_000
    bad = tmp_path / "bad.jsonl"
    for line in ("{", "[]", '{"key": ["fact"], "run": "none", "figures": {}}', '{"run": "a"}'):
        bad.write_text(path.read_text().splitlines()[0] + "\n" + line + "\n")
        with pytest.raises(InputError, match=r"bad.jsonl:2: expected a run or a cell, found"):
            PublishedCells.read(bad)


def test_cells_of_a_benchmark_are_taken_with_their_code_and_input(tmp_path):
    keys = all_keys()[:3]
    out = written(tmp_path / "out", [result(key, 0.0123456789) for key in keys])
    cells = PublishedCells()
    assert measured.take(cells, with_inputs(out)) == 3
    (first, *_) = cells.cells.values()
    assert first.figures["ate_m"]["rmse"] == 0.0123457 and "path" not in first.figures
    assert first.code == code_hash({"code": "other", "method_code": "c"}) and first.input
    assert first.code != code_hash({"code": "b", "method_code": "d"})
    assert [r.key for r in cells.benchmark()] == sorted(keys, key=lambda key: key.place)


def test_a_cell_that_takes_a_surface_away_is_named(tmp_path, capsys):
    with_surface, without = all_keys()[:2]
    cells = PublishedCells()
    for key, surface_m in ((with_surface, 0.02), (without, None)):
        out = written(tmp_path / key.place, [result(key, 0.01, surface_m)])
        assert measured.take(cells, with_inputs(out)) == 1
        assert not capsys.readouterr().err
    out = written(tmp_path / "bare", [result(key, 0.01) for key in (with_surface, without)])
    assert measured.take(cells, with_inputs(out)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{with_surface.place}: replaces a cell with a surface; iclnuim bench")


def test_a_folder_of_some_cells_draws_none_of_the_papers_figures(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(measured, "draw", lambda number, *_: drawn.append(number))
    monkeypatch.setattr(measured, "save", lambda *_: None)
    found = [result(key, 0.01) for key in all_keys()]
    measured.draw_paper_figures(written(tmp_path / "office", only(found, room="office")))
    without = [r for r in found if (r.key.trajectory, r.key.odometer) != ("kt2", "dvo")]
    measured.draw_paper_figures(written(tmp_path / "without", without))
    assert drawn == []
    measured.draw_paper_figures(written(tmp_path / "all", found))
    assert drawn == [5, 6, 7, 8, 9]


def with_inputs(out):
    """The folder, whose cells have an identity as measured ones have."""
    for file in out.rglob("*.cell.json"):
        content = json.loads(file.read_text())
        content["identity"] = {"input": {"sha256": "a"}, "code": "b", "method_code": "c"}
        file.write_text(json.dumps(content))
    return out


def test_cells_of_a_stress_are_taken_with_their_base(tmp_path, monkeypatch):
    key = StressKey("office/kt1", 80, "holes", 5, "icp", base=NOISY)
    store = Store(tmp_path / "stress", STRESS)
    store.open({}, {})
    store.write(Cell(key, {"input": "a", "method_code": "b"}), Outcome(120, 1.0, 0.01).to_dict())
    (tmp_path / measured.PAGES).mkdir(parents=True)
    line = {"run": MEASURED_RUN.name, **vars(MEASURED_RUN)}
    (tmp_path / measured.CELLS).write_text(json.dumps(line))
    monkeypatch.setattr(measured, "TOP", tmp_path)
    monkeypatch.setattr(measured, "draw_charts", lambda cells: drawn.append(list(cells.cells)))
    drawn = []
    assert measured.main(["--take", str(tmp_path / "stress")]) == 0
    cells = PublishedCells.read(tmp_path / measured.CELLS)
    (cell,) = cells.cells.values()
    assert list(cells.stress()) == [key] and cell.code and cell.input
    store.write(
        Cell(replace(key, severity=3), {"input": "a", "method_code": "b"}),
        Outcome(120, 1.0, 0.01).to_dict(),
    )
    assert measured.main(["--take", str(tmp_path / "stress")]) == 0
    assert drawn[-1] == list(PublishedCells.read(tmp_path / measured.CELLS).cells)
    assert len(drawn[-1]) == 2


def test_the_plan_names_what_is_missing_and_cells_of_other_code():
    def trajectories(cells):
        lines = [one for one in measured.missing_cells(cells) if "--no-surfaces" in one.command]
        return sum(one.cells for one in lines), sum(one.core_hours for one in lines)

    cells = PublishedCells()
    count, hours = trajectories(cells)
    total = sum(one.core_hours or 0 for one in measured.missing_cells(cells))
    assert count > 250 and 1 < hours < total < 80
    key = all_keys()[0]
    of_code = {"code": code_of_trajectory(key)}
    for code, left in (("", count - 1), ("other", count)):
        found = replace(result(key, 0.01), identity={"input": "a"})
        cells.add([found], KIND, MEASURED_RUN)
        (name,) = cells.cells
        cells.cells[name] = replace(cells.cells[name], code=code)
        assert trajectories(cells)[0] == left
    cells.cells[name] = replace(cells.cells[name], code=code_hash(of_code["code"]))
    assert trajectories(cells)[0] == count - 1


def test_the_plan_names_tables_of_other_rooms_and_missing_runs_and_segments(cells):
    def commands(of):
        return {one.command.split(" out/")[0]: one.cells for one in measured.missing_cells(of)}

    some = PublishedCells(dict(cells.cells))
    table = "python tools/measured.py --measure curve-levels"
    assert table not in commands(some)
    some.cells["table", "curve-levels"] = replace(some.cells["table", "curve-levels"], input="a")
    assert table in commands(some)
    runs = commands(some).get("iclnuim run orbslam3", 0)
    lines = {one.command: one.cells for one in measured.missing_cells(some)}
    fovis = [command for command in lines if command.endswith("--base clean --methods fovis")]
    assert fovis == []
    del some.cells["stress", "office/kt1", 80, "holes", 3, "fovis", ""]
    del some.cells[KIND, "office", "kt1", "clean", "ORB-SLAM3", "final", "run", 0, 2]
    lines = {one.command: one.cells for one in measured.missing_cells(some)}
    assert [
        n for command, n in lines.items() if command.endswith("--base clean --methods fovis")
    ] == [1]
    assert commands(some)["iclnuim run orbslam3"] == runs + 1


@pytest.mark.parametrize(
    "words", sorted({command for one in COMMAND_TABLES.values() for command in one.commands})
)
def test_its_commands_are_understood(words):
    command, *rest = shlex.split(words)
    assert cli.parsed(command, [*rest, "--json"]).json


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
ERROR = {"psnr_db": [40.0, 36.0], "median": 0.0028}
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
    "bench curve voxel": {"points": [VOXEL]},
    "bench curve": {"points": STEPS},
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
    "experiment sensors": {
        "cells": [{"variant": "d435", "missing_share": 0.05, "ate_m": {"icp": 0.002, "dvo": None}}]
    },
    "experiment inertial": {
        "cells": [
            {
                "sequence": f"office/{name}",
                "variant": f"black/{mode}",
                "ate_m": ates_m,
                "coverage": [0.8, 0.6, 0.3],
            }
            for name, mode, ates_m in (
                ("kt1", "rgbd", [0.05, None, 0.03]),
                ("kt1", "rgbd-inertial", [0.01, 0.03, 0.03]),
                ("kt2", "rgbd", [0.2, 0.2, 0.2]),
                ("kt2", "rgbd-inertial", [0.02, 0.2, 0.01]),
            )
        ]
    },
    "fuse out": {"memory_mb": 280.0, "parts_out_of_window": 0},
    "evaluate surface": {
        "distance_m": dict.fromkeys(("mean", "median", "std", "min", "max"), 0.0005)
    },
    "odometry ": {"runs": [RUN]},
    "run orbslam3": {
        "results": [
            {
                "sequence": "office/kt2/clean",
                "runs": [
                    {
                        "frames": 60,
                        "each": [
                            {"ate_rmse_m": ate_m, "initialised_s": s, "matched": matched}
                            for ate_m, s, matched in (
                                (0.010, 2.5, 60),
                                (0.012, 2.7, 31),
                                (0.001, 2.6, 29),
                                (None, None, 0),
                            )
                        ],
                    }
                ],
            }
        ]
    },
}


@pytest.mark.parametrize("one", COMMAND_TABLES.values(), ids=lambda one: one.mark)
def test_what_the_commands_print_becomes_rows_of_the_same_length(one):
    found = []
    for command in one.commands:
        outputs = [value for words, value in PRINTED.items() if command.startswith(words)]
        found.append(outputs[0])
    rows = one.rows(found)
    assert len(rows) >= 2 and len(set(map(len, rows))) == 1


def test_runs_with_an_imu_stand_beside_those_without_and_lost_ones_do_not_count():
    without, with_imu, later = (json.loads(json.dumps(PRINTED["run orbslam3"])) for _ in range(3))
    for printed, ate_m in ((without, 0.008), (later, 0.002)):
        for run in printed["results"][0]["runs"][0]["each"]:
            run |= {"ate_rmse_m": ate_m, "matched": 60}
    _, row = COMMAND_TABLES["systems-inertial"].rows([without, with_imu, without, later])
    assert row == [
        "office kt2 clean",
        "8 (8 to 8)",
        "11 (10 to 12)",
        "1.38",
        "8 (8 to 8)",
        "2 (2 to 2)",
        "0.25",
        "2.6 (2.5 to 2.7) s, 3 of 4 runs",
        "4 of 4 and 2 of 4",
    ]


def test_runs_whose_images_fail_count_within_the_bounds_of_stress():
    found = [PRINTED["experiment inertial"]] * 2
    _, *rows = COMMAND_TABLES["systems-failing"].rows(found)
    assert rows[:2] == [
        ["15 s", "office kt1", "black", "1 of 3", "50", "60%", "2 of 3", "20", "60%"],
        ["15 s", "office kt2", "black", "0 of 3", "-", "60%", "1 of 3", "20", "60%"],
    ]
    assert rows[2:] == [["20 s", *row[1:]] for row in rows[:2]]


def test_a_table_that_is_measured_becomes_a_cell_and_the_page(tmp_path, monkeypatch):
    page = tmp_path / "docs/measured/farm.md"
    (page.parent / "pictures").mkdir(parents=True)
    page.write_text(
        "before\n<!-- measured: farm-splits -->\nold\n<!-- end of farm-splits -->\nafter\n"
    )
    cells = PublishedCells()
    cells.add([replace(result(all_keys()[0], 0.01), identity={"input": "a"})], KIND, MEASURED_RUN)
    cells.write(tmp_path / measured.CELLS)
    monkeypatch.setattr(measured, "TOP", tmp_path)
    monkeypatch.setattr(measured, "draw_charts", lambda cells: None)
    split = {
        "light": "baked",
        "workers": 2,
        "threads": 2,
        "frames_an_hour": 27460.2,
        "busy_share": 0.914,
    }
    monkeypatch.setattr(measured, "output_of", lambda command: {"splits": [split]})
    assert measured.main(["--measure", "farm-splits"]) == 0
    assert page.read_text().splitlines()[3] == "| --- | --- | --- | --- | --- |"
    assert (
        "\n| 2 x 2 | 27,460 | 91% |  |  |\n<!-- end of farm-splits -->\nafter\n" in page.read_text()
    )
    stored = PublishedCells.read(tmp_path / measured.CELLS)
    assert stored.table("farm-splits")[1][:2] == ["2 x 2", "27,460"]


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
    rows = measured_tables._curve(1.0)([{"points": points}])
    assert rows[0] == ["", "icp"]  # a method without the setting has no column
    assert rows[1:] == [["1", "1.00, 1.00"], ["2", "2.00, 1.00"], ["4", "fails on 1"]]
    points[-2]["tracked"] = 10
    assert measured_tables._curve(1.0)([{"points": points}])[-1] == ["4", "0.71, 1.00 (75%)"]


def test_a_command_that_fails_ends_the_measurement_in_a_line(capfd):
    with pytest.raises(SystemExit, match="measured: iclnuim evaluate ended with exit code 2"):
        measured.output_of("evaluate no/such/file no/such/other")
    assert "Traceback" not in capfd.readouterr().err


def test_the_odometers_that_are_said_not_to_differ_have_intervals_that_hold_1(cells):
    _, *rows = DRAWN["learned-pairs"](cells)
    assert len(rows) == 6 and all(float(low) < 1 < float(high) for _, _, low, high, _ in rows)


def test_a_page_has_no_name_for_two_odometers(cells):
    """In the tables of stress, our odometers and the programs of authors are told apart."""
    header = [name.lower() for name in DRAWN["stress-fails"](cells)[0]]
    assert len(set(header)) == len(header)


@pytest.mark.parametrize("mark", ["stress-fails", "stress-totals", "learned-orbslam3"])
def test_tables_of_clean_frames_have_no_noisy_cell(mark, cells):
    """A shipped cell without a base in its key is of clean frames."""
    clean = {key: one for key, one in cells.cells.items() if key[0] != STRESS or NOISY not in key}
    assert len(clean) < len(cells.cells)
    assert DRAWN[mark](PublishedCells(clean)) == DRAWN[mark](cells)


def test_tables_of_noisy_frames_have_no_clean_cell(cells):
    noisy = {key: one for key, one in cells.cells.items() if key[0] == STRESS and NOISY in key}
    assert {key.base for key in PublishedCells(noisy).stress()} == {NOISY}
    for mark in ("stress-noisy", "stress-noisy-totals"):
        table = DRAWN[mark](PublishedCells(noisy))
        assert table == DRAWN[mark](cells) and len(table) > 1
    assert {row[0] for row in table[1:]} == set(paper_odometers())


def test_noisy_rows_say_their_severities_and_means_are_of_those_with_every_perturbation():
    cells = PublishedCells()
    for name, severity, success in (
        ("clean", 0, True),
        ("holes", 5, True),
        ("noise", 3, False),
        ("noise", 5, False),
    ):
        key = StressKey("office/kt1", 80, name, severity, "icp", base=NOISY)
        figures = {"frames": 120, "coverage": 1.0, "ate_m": 0.01, "success": success}
        cells.cells[STRESS, *key.words] = PublishedCell(MEASURED_RUN, figures)
    rows = DRAWN["stress-noisy"](cells)
    assert rows[1:] == [["`holes`", "5", "-"], ["`noise`", "3, 5", "3"]]
    (total,) = DRAWN["stress-noisy-totals"](cells)[1:]
    assert total[:4] == ["icp", "5", "2", "50.0%"]


def test_the_plan_names_the_base_of_missing_segments(cells):
    def counts(of):
        return Counter({one.command: one.cells for one in measured.missing_cells(of)})

    some = PublishedCells(dict(cells.cells))
    for base in BASES:
        del some.cells[STRESS, *StressKey("office/kt1", 80, "holes", 5, "icp", base=base).words]
    more = counts(some) - counts(cells)
    assert sorted(more.values()) == [1, 1]
    for command in more:
        words = command.removeprefix("iclnuim ").split()
        assert f"--base {cli.parsed(words[0], words[1:]).base} --methods icp" in command
    assert len({command.split("--base")[1] for command in more}) == 2
