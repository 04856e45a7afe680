"""Parameters of the public functions as tables: what their docstrings say of a parameter, `name: text`,
stands in a row (mkdocs.yml names this extension of griffe).
"""

import re
from typing import Any

from griffe import Docstring, Extension, Function


class ParameterTables(Extension):
    """Give the docstring of each function a table of the parameters that it explains."""

    def on_function_instance(self, *, func: Function, **_: Any) -> None:
        if func.docstring:
            names = [one.name for one in func.parameters]
            value = with_table(func.docstring.value, names)
            func.docstring = Docstring(value, parent=func)


def with_table(text: str, names: list[str]) -> str:
    """A docstring whose explanations of these parameters are a table at its end, as Markdown."""
    known = "|".join(map(re.escape, names)) or "(?!)"
    begin = rf"(?:^|(?<=[.;,] ))(?:(?:{known})(?:, )?)+: "
    rows, paragraphs = [], []
    for paragraph in re.split(r"\n\s*\n", text):
        line = " ".join(paragraph.split())
        starts = [found.start() for found in re.finditer(begin, line)]
        rest = line[: starts[0]] if starts else line
        for start, end in zip(starts, [*starts[1:], len(line)], strict=False):
            said, more = first_sentence(line[start:end].strip())
            name, _, meaning = said.partition(": ")
            rows.append(f"| `{name}` | {meaning.rstrip(';,.').replace('|', '&#124;')} |")
            rest += f" {more}" if more else ""
        paragraphs.append(rest.strip() if starts else paragraph)
    if not rows:
        return text
    table = "\n".join(["| parameter | meaning |", "|---|---|", *rows])
    return "\n\n".join([one for one in paragraphs if one] + [table])


def first_sentence(text: str) -> tuple[str, str]:
    """The first sentence, and what follows it."""
    found = re.search(r"\. (?=[A-Z])", text)
    return (text[: found.start() + 1], text[found.end() :]) if found else (text, "")
