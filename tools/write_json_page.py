"""Writes docs/reference/json.md, every key of what the commands print with --json, from
tools/json_keys.toml: `python tools/write_json_page.py`. With --check it only compares the page.
"""

import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

PAGE = Path(__file__).resolve().parents[1] / "docs/reference/json.md"
DECLARATIONS = Path(__file__).with_name("json_keys.toml")
HEAD = """# JSON

With `--json` a command prints one object on standard output. This page has its keys (`python tools/write_json_page.py`
writes it from declarations that a test compares with what the commands print). A dot leads to a key of an inner object, `[]` to those
of each object of a list, `*` stands for any name. Numbers that do not exist (NaN, infinite) are null. `to_dict()` of results in Python
has the same keys. Files beside results, such as recipes, are settings: [settings.md](settings.md).
"""


class Key(NamedTuple):
    """A key of the JSON of a command. optional: whether it is there only in some cases."""

    path: str
    unit: str
    meaning: str
    optional: bool = False

    def below(self, path: str) -> "Key":
        return self._replace(path=".".join(filter(None, (path, self.path))))

    def fits(self, found: str) -> bool:
        """Whether this declares a key that was found; a name of any object may be `*` here."""
        own = self.path.split(".")
        parts = found.split("\0")
        return len(own) == len(parts) and all(map(fnmatchcase, parts, map(_pattern, own)))


def _pattern(name: str) -> str:
    return name.replace("[]", "[[]]")


class Section(NamedTuple):
    """What a command prints. lines: command lines of which the test compares the keys."""

    command: str
    about: str
    lines: tuple[str, ...]
    keys: tuple[Key, ...]


@cache
def sections() -> tuple[Section, ...]:
    """The sections of all commands, in the order of the declarations."""
    content = tomllib.loads(DECLARATIONS.read_text(encoding="utf-8"))
    shapes = content.pop("shapes")
    found = []
    for command, one in content.items():
        keys = tuple(_keys(one["keys"], shapes))
        found.append(Section(command, one.get("about", ""), tuple(one.get("lines", ())), keys))
    return tuple(found)


def _keys(declared: dict[str, str], shapes: dict[str, Any]) -> Iterator[Key]:
    for path, text in declared.items():
        if text.startswith("= "):
            shape, _, rest = text.removeprefix("= ").partition(" | ")
            unit, _, of = rest.partition(" | ")
            for key in _keys(shapes[shape], shapes):
                meaning = f"{of}: {key.meaning}" if of else key.meaning
                yield key._replace(unit=unit or key.unit, meaning=meaning).below(path)
            continue
        unit, bar, meaning = text.partition(" | ")
        if not bar:
            unit, meaning = "", text
        yield Key(path.removesuffix("?"), unit, meaning, path.endswith("?"))


def page() -> str:
    """The text of docs/reference/json.md."""
    parts = [HEAD]
    for section in sections():
        parts.append(f"## {section.command}\n")
        if section.about:
            parts.append(f"{section.about}\n")
        parts += ["| key | unit | meaning |", "|---|---|---|"]
        for key in section.keys:
            mark = " (in some cases)" if key.optional else ""
            parts.append(f"| `{key.path}`{mark} | {key.unit} | {key.meaning} |")
        parts.append("")
    return "\n".join(parts)


def main() -> int:
    """Write the page, or compare it; returns the exit code."""
    if "--check" in sys.argv[1:]:
        return 0 if PAGE.read_text(encoding="utf-8") == page() else 1
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
