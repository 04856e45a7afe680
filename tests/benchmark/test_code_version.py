"""The hash of the code of a result: it changes with what the code does, and with nothing else."""

import importlib
import itertools
import re

import pytest
from iclnuim.benchmark.experiments import code_version
from iclnuim.benchmark.odometry.registry import ODOMETERS

#: A package of two modules. `error` is what is hashed, and reaches all but `unused`.
PACKAGE = {
    "__init__": "",
    "errors": """
from . import scale
from .lines import Line

LIMIT = 3
#: Of nothing.
OTHER = 1


def error(x):
    from .lines import length

    return length(Line(x)) * scale.factor(LIMIT)


def unused(x):
    return x + OTHER
""",
    "lines": """
from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    x: float


def length(line):
    return abs(line.x)
""",
    "scale": "def factor(limit):\n    return limit / 2\n",
}
NAMES = (f"hashed_{number}" for number in itertools.count())


@pytest.fixture
def hash_of(tmp_path, monkeypatch):
    """The hash of the function in a package of these modules, by `module:name`."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(code_version, "_ROOMS", re.compile(r"hashed_\d+\b"))

    def made(modules, entry="errors:error", **options):
        name = next(NAMES)
        (tmp_path / name).mkdir()
        for module, text in modules.items():
            (tmp_path / name / f"{module}.py").write_text(text)
        importlib.invalidate_caches()
        without = tuple(f"{name}.{one}" for one in options.get("without", ()))
        return code_version.code_of(f"{name}.{entry}", without=without)

    return made


def changed(module, old, new):
    assert old in PACKAGE[module]
    return PACKAGE | {module: PACKAGE[module].replace(old, new)}


@pytest.mark.parametrize(
    "other",
    [
        changed("errors", "#: Of nothing.\n", '"""Of the limit."""\n'),
        changed("errors", "def error(x):\n", 'def error(x):\n    """The error."""\n'),
        changed("errors", "LIMIT = 3", "LIMIT = (\n    3\n)"),
        changed("errors", "x + OTHER", "x - OTHER"),
        changed("errors", "OTHER = 1", "OTHER = 2"),
        changed("lines", "abs(line.x)", "abs(line.x)  # of one dimension"),
        changed("scale", "def factor", "def more():\n    return 1\n\n\ndef factor"),
    ],
)
def test_words_and_what_is_not_reached_do_not_change_it(hash_of, other):
    assert hash_of(other) == hash_of(PACKAGE)


@pytest.mark.parametrize(
    "other",
    [
        changed("errors", "LIMIT = 3", "LIMIT = 4"),
        changed("errors", "* scale", "/ scale"),
        changed("lines", "abs(line.x)", "line.x"),
        changed("lines", "x: float", "x: float = 0"),
        changed("lines", "frozen=True", "frozen=False"),
        changed("scale", "limit / 2", "limit / 3"),
    ],
)
def test_what_is_reached_changes_it(hash_of, other):
    assert hash_of(other) != hash_of(PACKAGE)


def test_a_file_that_is_renamed_moved_or_merged_does_not_change_it(hash_of):
    expected = hash_of(PACKAGE)
    renamed = {"factors": PACKAGE["scale"], **PACKAGE}
    renamed["errors"] = renamed["errors"].replace("scale", "factors")
    assert hash_of(renamed) == expected
    imported = changed("errors", "from . import scale", "from .scale import factor")
    imported["errors"] = imported["errors"].replace("scale.factor", "factor")
    assert hash_of(imported) == expected
    body = imported["errors"].replace("    from .lines import length\n\n", "")
    body = re.sub(r"from .(lines|scale) import .*\n", "", body)
    merged = {"__init__": "", "all": PACKAGE["lines"] + PACKAGE["scale"] + body}
    assert hash_of(merged, "all:error") == expected
    inside = {"__init__": PACKAGE["scale"], "errors": imported["errors"].replace(".scale", ".")}
    assert hash_of(inside | {"lines": PACKAGE["lines"]}) == expected


def test_another_name_does_not_change_it(hash_of):
    expected = hash_of(PACKAGE)
    other = changed("errors", "LIMIT = 3", "HIGHEST = 3")
    other["errors"] = other["errors"].replace("factor(LIMIT)", "factor(HIGHEST)")
    assert hash_of(other) == expected
    other = changed("lines", "class Line", "class Segment")
    other["errors"] = other["errors"].replace("Line", "Segment")
    assert hash_of(other) == expected
    twice = changed("lines", "def length", "Other = Line\n\n\ndef length")
    twice["errors"] = twice["errors"].replace("Line", "Other")
    assert hash_of(twice) == expected


def test_the_same_definitions_in_other_places_change_it(hash_of):
    text = "A = {}\nB = {}\n\n\ndef f(x):\n    return A * x - B\n"
    package = {"__init__": "", "m": text.format(1, 2)}
    assert hash_of(package, "m:f") != hash_of(package | {"m": text.format(2, 1)}, "m:f")


def test_what_is_left_out_counts_neither_itself_nor_with_what_it_reaches(hash_of):
    without = {"without": ("scale:factor",)}
    assert hash_of(PACKAGE, **without) != hash_of(PACKAGE)
    other = changed("scale", "limit / 2", "limit / 3")
    assert hash_of(other, **without) == hash_of(PACKAGE, **without)


def test_the_texts_of_a_setting_do_not_change_it(hash_of):
    def of(value, label):
        text = f"FX = parameter({value}, label={label!r}, unit='px')\n"
        return hash_of({"__init__": "", "camera": text}, "camera:FX")

    assert of(481.2, "fx") == of(481.2, "Focal Length fx") != of(480.0, "fx")


def test_an_entry_that_is_not_there_is_an_error(hash_of):
    with pytest.raises(LookupError, match="errors:missing is not defined"):
        hash_of(PACKAGE, "errors:missing")


def test_every_odometer_has_code_of_its_own():
    found = {code_version.method_code(name) for name in ODOMETERS}
    assert len(found) == len(ODOMETERS)
    reached = code_version._meaning(("iclnuim.benchmark.odometry.icp", "Icp"))[1]
    assert ("iclnuim.benchmark.odometry.terms.plane", "PlaneTerm") in reached
