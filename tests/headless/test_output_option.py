"""An output is given by `-o` in every command; after the input it is understood as well."""

import pytest
from iclnuim.headless import cli

WITH_OUT = ("dataset raw", "convert seq", "noise seq")


@pytest.mark.parametrize("line", WITH_OUT)
@pytest.mark.parametrize("words", [("new",), ("-o", "new"), ("--out", "new"), ("--out=new",)])
def test_an_output_is_understood_in_each_place(line, words):
    command, source = line.split()
    for order in ([source, *words], [source, *words, "--frames", ":2"]):
        assert str(cli.parsed(command, order).out) == "new"
    if len(words) == 2:
        assert str(cli.parsed(command, [*words, source]).out) == "new"


@pytest.mark.parametrize("line", WITH_OUT)
def test_a_missing_output_is_told(line, capsys):
    assert cli.main(line.split()) == 2
    assert "expected an output: OUT, or --out OUT" in capsys.readouterr().err
