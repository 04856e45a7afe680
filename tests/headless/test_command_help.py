"""The help of `iclnuim`: commands in groups, and what was meant by a misspelt word."""

import re

import pytest
from iclnuim.headless import cli
from iclnuim.version import __version__


def test_commands_stand_in_groups_and_those_for_insiders_last(capsys):
    assert cli.main(["--help"]) == 0
    said = capsys.readouterr().out
    titles = re.findall(r"^(\w.*):$", said, re.M)
    assert titles == list(cli.GROUPS) and "development" in titles[-1]
    assert re.findall(r"^  (\S+)  ", said, re.M) == [
        name for group in cli.GROUPS.values() for name in group
    ]
    assert {"task", "bench", "scene"} <= cli.GROUPS[titles[-1]].keys()


def test_each_command_is_in_one_group_and_in_the_table(capsys):
    names = [name for group in cli.GROUPS.values() for name in group]
    assert sorted(names) == sorted(cli.COMMANDS) == sorted(set(names))
    assert list(cli.COMMANDS) == names


@pytest.mark.parametrize(
    ("word", "meant"), [("mkae", "make"), ("evalute", "evaluate"), ("benchmrk", "benchmark")]
)
def test_a_misspelt_command_is_told_what_was_meant(word, meant, capsys):
    assert cli.main([word]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert f"found {word!r}; try {meant}" in said


def test_a_word_that_resembles_no_command_leads_to_the_help(capsys):
    assert cli.main(["xyzzy"]) == 2
    assert capsys.readouterr().err.endswith("try iclnuim --help, which lists them\n")


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("make kt2 --quikc", "--quick"),
        ("make kt2 --depth-niose=paper", "--depth-noise"),
        ("evaluate rpe a b --dleta 1s", "--delta"),
        ("stress seq --severites 1", "--severities"),
        ("dataset raw out --klg", "--rosbag, or png_to_klg, which makes a log of a tum sequence"),
    ],
)
def test_a_misspelt_option_is_told_what_was_meant(line, meant, capsys):
    with pytest.raises(SystemExit) as exit:
        cli.main(line.split())
    (said,) = capsys.readouterr().err.splitlines()
    assert exit.value.code == 2 and f"; try {meant}" in said


def options_of(action, capsys):
    with pytest.raises(SystemExit):
        cli.main(["trajectory", action, "--help"])
    return set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", capsys.readouterr().out))


def test_what_is_suggested_is_an_option_of_the_action_itself(capsys):
    """Each option that another action has and this one has not is refused, and not suggested."""
    own = options_of("make", capsys)
    others = options_of("convert", capsys) | options_of("camera", capsys)
    assert others - own
    for option in sorted(others - own):
        with pytest.raises(SystemExit):
            cli.main(["trajectory", "make", option])
        said = capsys.readouterr().err
        assert f"unrecognized arguments: {option}; try " in said
        suggested = said.rpartition("; try ")[2].strip()
        assert suggested == "iclnuim trajectory make --help" or set(suggested.split(" or ")) <= own


def test_an_option_that_resembles_none_leads_to_the_help(capsys):
    with pytest.raises(SystemExit):
        cli.main(["make", "kt2", "--xyzzy"])
    assert capsys.readouterr().err.endswith("--xyzzy; try iclnuim make --help\n")


@pytest.mark.parametrize("option", ["-V", "--version"])
def test_the_version(option, capsys):
    assert cli.main([option]) == 0
    assert capsys.readouterr().out == f"iclnuim {__version__}\n"
