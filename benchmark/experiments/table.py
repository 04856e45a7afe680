"""A table of texts, and its output for a terminal, in Markdown, in LaTeX and as CSV."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, zip_longest
from pathlib import Path
from textwrap import wrap

from iclnuim.formats.files import atomic_write_text, csv_text, make_folder

#: What stands in the place of a figure that no cell has.
NOT_MEASURED = "not measured"
#: Maximum width of a column in a terminal, in characters.
_WIDEST = 34
#: A column with a longer text, in characters, is set as paragraphs in a page and in LaTeX.
_LONG = 40
#: Characters with a special meaning in LaTeX -> their escapes.
_LATEX = {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "\u03c1": r"$\rho$"}
_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?( \[.*\])?")


@dataclass(frozen=True)
class Mark:
    """Style and tooltip of a field of a table in a page."""

    style: str = ""
    tooltip: str = ""


@dataclass(frozen=True)
class ResultTable:
    """name: base name of its files. rows: one text per column. bold: (row, column) of the best
    figures. notes: sentences below the table. marks: by (row, column).
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    bold: frozenset[tuple[int, int]] = frozenset()
    notes: tuple[str, ...] = ()
    marks: Mapping[tuple[int, int], Mark] = field(default_factory=dict)

    def of_preset(self, preset: str) -> "ResultTable":
        """The table with the name of a preset, unless that is `best`."""
        if preset == "best":
            return self
        title = f"{self.title} Preset {preset}."
        return replace(self, name=f"{self.name}_{preset}", title=title)

    def varying(self, columns: Sequence[str]) -> "ResultTable":
        """The table with those of the columns in which rows differ; the title has the others."""
        constant = []
        shown = []
        for name in columns:
            texts = self.column(self.columns.index(name))
            if len(texts) > 1 and len(set(texts)) == 1:
                constant += [f"{name} {texts[0]}"] if texts[0] else []
            else:
                shown.append(name)
        kept = [self.columns.index(name) for name in shown]
        rows = tuple(tuple(row[j] for j in kept) for row in self.rows)
        title = self.title
        if constant:
            title = f"{title.removesuffix('.')}: {', '.join(constant)}."
        return replace(self, title=title, columns=tuple(shown), rows=rows)

    def column(self, j: int) -> list[str]:
        """The texts of a column, without its head."""
        return [row[j] for row in self.rows]

    def is_number(self, j: int) -> bool:
        """Whether a column contains numbers, and otherwise only empty texts and dashes."""
        given = [text for text in self.column(j) if text not in ("", "-")]
        return bool(given) and all(map(_NUMBER.fullmatch, given))

    def is_long(self, j: int) -> bool:
        """Whether a column has long texts."""
        return any(len(text) > _LONG for text in self.column(j))

    @property
    def long_columns(self) -> bool:
        return any(map(self.is_long, range(len(self.columns))))

    def classes(self, i: int, j: int) -> str:
        """CSS classes of a field in a page."""
        found = {
            "n": self.is_number(j),
            "b": (i, j) in self.bold,
            "text": self.is_long(j),
            "mark": (i, j) in self.marks,
        }
        names = [name for name, given in found.items() if given]
        if self.columns[j] == "verdict":
            names += ["verdict", f"v-{self.rows[i][j].split()[0]}"]
        return " ".join(names)

    def text(self) -> str:
        """The table for a terminal; a star marks the best figures."""
        rows = [list(self.columns), *self._marked(lambda text: f"{text}*")]
        wrapped = [[wrap(text, _WIDEST) or [""] for text in row] for row in rows]
        columns = list(zip(*wrapped, strict=True))
        widths = [max(map(len, chain.from_iterable(column))) for column in columns]
        right = [self.is_number(j) for j in range(len(self.columns))]
        lines = []
        for row in wrapped:
            for texts in zip_longest(*row, fillvalue=""):
                lines.append(_line(texts, widths, right))
        legend = ["A star marks the smallest of each trajectory."] if self.bold else []
        return "\n".join([*filter(None, [self.title]), *lines, *legend, *self.notes])

    def _marked(self, mark: Callable[[str], str]) -> list[list[str]]:
        """The rows, with the best figures marked."""
        rows = [list(row) for row in self.rows]
        for i, j in self.bold:
            rows[i][j] = mark(rows[i][j])
        return rows

    def markdown(self) -> str:
        columns = range(len(self.columns))
        rule = [(":--", "--:")[self.is_number(j)] for j in columns]
        lines = []
        for row in (self.columns, rule, *self._marked(lambda text: f"**{text}**")):
            lines.append("| " + " | ".join(text.replace("|", r"\|") for text in row) + " |")
        return "\n".join([f"**{self.title}**", "", *lines, "", *self.notes]).rstrip()

    def latex(self) -> str:
        """A table environment that needs no package.

        Numbers are right-aligned, long texts are set as paragraphs.
        """
        forms = []
        for j in range(len(self.columns)):
            text = "p{0.2\\linewidth}" if self.is_long(j) else "l"
            forms.append("r" if self.is_number(j) else text)
        lines = [r"\begin{table}", r"\centering", rf"\caption{{{_escaped(self.title)}}}"]
        lines += [rf"\begin{{tabular}}{{{''.join(forms)}}}", r"\hline"]
        lines += [" & ".join(map(_escaped, self.columns)) + r" \\", r"\hline"]
        for i, row in enumerate(self.rows):
            texts = list(map(_escaped, row))
            for j in range(len(texts)):
                if (i, j) in self.bold:
                    texts[j] = rf"\textbf{{{texts[j]}}}"
            lines.append(" & ".join(texts) + r" \\")
        notes = [rf"\\ {_escaped(note)}" for note in self.notes]
        return "\n".join([*lines, r"\hline", r"\end{tabular}", *notes, r"\end{table}"])

    def csv(self) -> str:
        return csv_text((self.columns, *self.rows)).removesuffix("\n")


def shown(value: float | None, spec: str, factor: float = 1) -> str:
    """A figure times a factor as a text; a dash for None."""
    return "-" if value is None else format(factor * value, spec)


def mm(length_m: float | None, spec: str = ".3g") -> str:
    """A length in mm as a text; a dash for None."""
    return shown(length_m, spec, 1e3)


def _line(texts: Sequence[str], widths: Sequence[int], right: Sequence[bool]) -> str:
    padded = []
    for text, width, is_right in zip(texts, widths, right, strict=True):
        padded.append(text.rjust(width) if is_right else text.ljust(width))
    return "  ".join(padded).rstrip()


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


#: Format -> (file ending, function that writes a table).
FORMATS: dict[str, tuple[str, Callable[[ResultTable], str]]] = {
    "text": ("txt", ResultTable.text),
    "markdown": ("md", ResultTable.markdown),
    "latex": ("tex", ResultTable.latex),
    "csv": ("csv", ResultTable.csv),
}


def write_tables(folder: Path, tables: Sequence[ResultTable]) -> None:
    """Write each table in every format. Their content does not depend on time or speed."""
    make_folder(folder)
    for table in tables:
        for ending, written in FORMATS.values():
            atomic_write_text(folder / f"{table.name}.{ending}", written(table) + "\n")
