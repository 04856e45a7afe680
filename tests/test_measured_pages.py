"""tools/measured.py: every mark is in its page once, every command is understood, and what commands print becomes tables."""

import re
import shlex

import pytest
from iclnuim.headless import cli
from iclnuim.tools import measured
from iclnuim.tools.measured import MEASURED, replaced


def test_every_marked_table_has_its_command_and_every_command_its_marked_table(repository):
    pages = {page: page.read_text() for page in (*(repository / "docs").glob("*.md"), repository / "README.md")}
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


def test_what_is_kept_is_not_measured_again_and_becomes_the_table(tmp_path, monkeypatch):
    page = tmp_path / "docs/farm.md"
    page.parent.mkdir()
    page.write_text("before\n<!-- measured: farm-splits -->\nold\n<!-- end of farm-splits -->\nafter\n")
    monkeypatch.setattr(measured, "TOP", tmp_path)
    split = {"light": "baked", "workers": 2, "threads": 2, "frames_an_hour": 27460.2, "busy_share": 0.914}
    monkeypatch.setattr(measured, "output_of", lambda command, keep: {"splits": [split]})
    assert measured.main(["--only", "farm-splits"]) == 0
    assert page.read_text().splitlines()[3] == "| --- | --- | --- | --- | --- |"
    assert "\n| 2 x 2 | 27,460 | 91% |  |  |\n<!-- end of farm-splits -->\nafter\n" in page.read_text()
