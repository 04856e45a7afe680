"""The paper's tables beside our figures, in every format, and the command that makes them of what
was measured.
"""

import csv
import io
import json
from dataclasses import replace

import pytest
from iclnuim.benchmark.experiments.recipes.paper.figures import paper
from iclnuim.benchmark.experiments.recipes.paper.keys import (
    PaperKey,
    all_keys,
    chosen,
    paper_odometers,
)
from iclnuim.benchmark.experiments.recipes.paper.tables import (
    all_tables,
    cells_table,
    preset_tables,
)
from iclnuim.benchmark.experiments.table import ResultTable
from iclnuim.errors import InputError
from iclnuim.headless import cli
from made_up import external, only, result, results, written

ICP = PaperKey("living_room", "kt2", "clean", "icp", "best", "model")


def named(tables, name):
    return next(table for table in tables if table.name == name)


@pytest.mark.parametrize("number", ["2", "3", "4", "5", "6", "7"])
def test_the_printed_figures_are_the_papers(number):
    """In mm with a decimal: all that Tables II to VII print, and nothing else."""
    table, printed = named(preset_tables([], "best"), f"table_{number}"), paper()["tables"][number]
    columns = [k for k, name in enumerate(table.columns) if name == "printed"]
    shown = sorted(float(row[k]) for row in table.rows for k in columns if row[k])
    expected = [
        1e3 * v for odometer in printed.values() for kt in odometer.values() for v in kt.values()
    ]
    assert shown == pytest.approx(sorted(expected), abs=0.051)


def test_ours_stand_in_their_row_and_column_and_the_least_is_marked():
    some = [
        result(ICP, 0.0015, 0.003),
        result(replace(ICP, odometer="dvo", reference="default"), 0.02, 0.001),
    ]
    table = named(preset_tables(some, "best"), "table_3")
    row, column = 6 * paper_odometers().index("icp"), table.columns.index("kt2")
    assert (
        table.rows[row][column] == "1.50"
        and (row, column) in table.bold
        and (0, column) not in table.bold
    )
    surfaces = named(preset_tables(some, "best"), "table_2")
    assert surfaces.rows[0][surfaces.columns.index("kt2")] == "3.00"
    assert not any(
        named(preset_tables(some, "best"), "table_5").rows[row][column] for row in range(30)
    )


def test_a_table_of_fewer_frames_than_a_sequence_has_names_them_and_its_star_is_explained():
    other = replace(ICP, odometer="dvo", reference="default")
    some = [result(ICP, 0.0015, 0.003), result(other, 0.02, 0.001, frames=882)]
    for name in ("table_2", "table_3"):
        text = named(preset_tables(some, "best"), name).text()
        assert "Ours are of fewer frames than the sequences have: kt2 60 of 882." in text
    assert "A star marks the smallest of each trajectory." in text
    whole = named(preset_tables([result(ICP, 0.0015, frames=882)], "best"), "table_3")
    assert not any("fewer frames" in note for note in whole.notes)


def test_several_seeds_are_their_median_and_their_ends():
    cell = replace(ICP, noise="noisy")
    some = [result(replace(cell, seed=seed), 0.01 * (seed + 1), 0.003) for seed in range(3)]
    table = named(preset_tables(some, "best"), "table_5")
    assert table.rows[18][table.columns.index("kt2")] == "20.00 [10.00, 30.00]"
    assert table.is_number(table.columns.index("kt2"))


def test_the_rows_of_a_table_are_of_the_same_seeds():
    cell = replace(ICP, noise="noisy")
    some = [result(replace(cell, seed=seed), 0.01 * (seed + 1)) for seed in range(3)]
    part = result(replace(cell, seed=3), 0.9)
    some.append(replace(part, figures=part.figures | {"ate_m": {"rmse": 0.9}}))
    table = named(preset_tables(some, "best"), "table_5")
    rows = [row[table.columns.index("kt2")] for row in table.rows[18:24]]
    assert set(rows) == {"20.00 [10.00, 30.00]"}
    alone = named(preset_tables(some[3:], "best"), "table_5")
    assert alone.rows[18][alone.columns.index("kt2")] == "900.00"


def test_systems_of_others_are_further_rows_with_their_median():
    some = [result(ICP, 0.0015), *(result(external(ICP, run), 0.001 * run) for run in (1, 2, 3))]
    table = named(preset_tables(some, "best"), "table_3")
    assert (
        table.rows[-1][:2] == ("ORB-SLAM3", "RMSE")
        and table.rows[-1][table.columns.index("kt2")] == "2.00 [1.00, 3.00]"
    )


def test_a_table_is_the_same_in_every_format():
    rows = (("a_b", "1.5"), ('c, "d"', "22"), ("50 % & more " + "x " * 30, ""))
    table = ResultTable("t", "Of a_b", ("what", "mm"), rows, frozenset({(0, 1)}), ("a note",))
    assert list(csv.reader(io.StringIO(table.csv()))) == [
        list(row) for row in (table.columns, *rows)
    ]
    lines = table.markdown().splitlines()
    assert (
        lines[2] == "| what | mm |"
        and lines[3] == "| :-- | --: |"
        and "**1.5**" in lines[4]
        and lines[-1] == "a note"
    )
    assert r"a\_b & \textbf{1.5} \\" in table.latex() and r"50 \% \& more" in table.latex()
    text = table.text().splitlines()
    assert text[2].endswith(" 1.5*") and max(map(len, text)) < 50


def test_cells_are_named_once_and_chosen_by_their_words():
    cells = all_keys(("best", "paper"), range(3))
    assert len({cell.place for cell in cells}) == len(cells)
    assert len(all_keys()) == 2 * 4 * 2 * 8
    few = chosen(all_keys(), "living_room/kt0,kt2/icp/model")
    assert {cell.trajectory for cell in few} == {"kt0", "kt2"} and {
        cell.odometer for cell in few
    } == {"icp"}
    assert len(few) == 4
    with pytest.raises(InputError, match="kt9"):
        chosen(all_keys(), "kt9")
    with pytest.raises(InputError, match="a comma means or"):
        chosen(all_keys(), "kt0/icp,kt2/dvo")
    assert {cell.reference for cell in all_keys(references=("frame",))} == {"frame"}


def test_the_command_makes_its_tables_again_to_the_byte(tmp_path, capsys):
    out = written(tmp_path / "bench", only(results(2), room="living_room", trajectory="kt0"))
    files = []
    for _ in range(2):
        assert cli.main(["benchmark", "--report-only", "--out", str(out), "--json"]) == 0
        files.append({p.name: p.read_bytes() for p in (out / "tables").iterdir()})
        shown = json.loads(capsys.readouterr().out)
        assert len(shown["cells"]) == 16 and len(shown["tables"]["table_3"]["rows"]) == 30
    assert files[0] == files[1] and len(files[0]) == 4 * 14


def test_what_is_missing_is_one_line(tmp_path, capsys):
    assert cli.main(["benchmark", "--report-only", str(tmp_path)]) == 2
    assert (
        cli.main(
            ["benchmark", "--data", str(tmp_path), "--out", str(tmp_path / "o"), "--only", "kt2"]
        )
        == 2
    )
    error = capsys.readouterr().err
    assert "make living_room/kt2" in error and "sequences to measure on" in error
    assert cli.main(["table", "3", "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("words", [["table", "3"], ["table", "1"], ["figure", "6"]], ids=" ".join)
def test_an_unknown_preset_is_refused_by_name(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.main([*words, "--preset", "foo"])
    error = capsys.readouterr().err
    assert all(word in error for word in ("--preset", "'foo'", "best", "paper"))


def test_one_table_of_a_benchmark_in_a_format(tmp_path, capsys):
    out = written(tmp_path / "bench", [result(ICP, 0.0015, 0.003)])
    assert cli.main(["table", "3", "--out", str(out), "--format", "latex"]) == 0
    assert r"\textbf" in capsys.readouterr().out
    assert named(all_tables([result(ICP, 0.0015, 0.003)]), "cells").rows[0][:7] == (
        "living_room", "kt2", "clean", "0", "icp", "best", "model",
    )  # fmt: skip


def test_a_name_stays_in_one_line_and_a_sentence_is_a_paragraph():
    """The longest name of a method or a sequence has some thirty characters."""
    columns = ("method", "what was found")
    rows = (("open3d-hybrid on living_room", "all poses after the first second are lost"),)
    table = ResultTable("names", "Names.", columns, (*rows, ("icp", "x" * 60)))
    assert [table.is_long(0), table.is_long(1)] == [False, True]


def test_a_name_and_a_sentence_fit_into_the_columns_of_a_terminal():
    """The sentence is wrapped, the name is not."""
    name = "icp_rgbd on living_room/kt0"
    table = ResultTable("names", "", ("method", "finding"), ((name, "lost at the wall " * 9),))
    lines = table.text().splitlines()
    assert max(map(len, lines)) <= 80
    assert any(name in line for line in lines)


def test_the_frames_that_a_system_has_no_pose_of_are_lost():
    run = result(external(ICP, 1), 0.01, coverage=0.35)
    del run.figures["lost"]
    table = cells_table([run, result(ICP, 0.01)])
    place = table.columns.index("lost")
    assert [row[place] for row in table.rows] == ["39", "0"]


def report_of(found, out, capsys):
    written(out, found)
    assert cli.main(["benchmark", "--report-only", "--out", str(out), "--quiet"]) == 0
    return capsys.readouterr().out


def test_few_cells_fit_a_screen_and_what_was_not_measured_is_one_line(tmp_path, capsys):
    text = report_of(results(3)[:30], tmp_path / "few", capsys).splitlines()
    assert text[0].startswith("All cells: room living_room, seed 0, preset best")
    assert text[1].split()[:3] == ["trajectory", "noise", "odometer"]
    assert text[32] == "" and len(text) < 50
    assert text[34].split() == ["no.", "verdict"]
    assert len([line for line in text if "need more cells than these 30" in line]) == 1
    page = (tmp_path / "few/report.html").read_text()
    assert page.index('id="cells"') < page.index('id="tables"') < page.index('id="findings"')
    whole = report_of(results(3), tmp_path / "whole", capsys)
    assert "All cells" not in whole and "need more cells" not in whole
    page = (tmp_path / "whole/report.html").read_text()
    assert page.index('id="findings"') < page.index('id="tables"') < page.index('id="cells"')
    many = report_of(results(3)[:50], tmp_path / "many", capsys)
    assert many.startswith("The method with the least") and "All cells" not in many
    assert "Table II:" in many and "Table VI:" not in many


def test_without_cells_of_its_own_a_checkout_shows_the_shipped_ones(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["table", "3"]) == 0
    shown = capsys.readouterr()
    assert "shipped" in shown.err and "dvo_core" in shown.out
    assert cli.main(["table", "3", "--preset", "paper"]) == 0
    assert "dvo_core" in capsys.readouterr().out
    for number in (5, 8):
        picture = tmp_path / f"figure_{number}.png"
        assert cli.main(["figure", str(number)]) == 0 and picture.stat().st_size > 10_000
    capsys.readouterr()
    assert cli.main(["table", "3", "--out", str(tmp_path)]) == 2
    assert "expected a benchmark with measured cells" in capsys.readouterr().err
    monkeypatch.setattr("iclnuim.checkout.ROOT", tmp_path)  # as an installation
    assert cli.main(["table", "3"]) == 2
    assert "out/benchmark: expected a benchmark with measured" in capsys.readouterr().err
