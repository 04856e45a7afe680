"""A table of texts, and its output for a terminal, in Markdown, in LaTeX and as CSV."""

import csv
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import zip_longest
from textwrap import wrap

#: Maximum width of a column in a terminal, in characters.
_WIDEST = 34
#: Characters with a special meaning in LaTeX -> their escapes.
_LATEX = {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "\u03c1": r"$\rho$"}
_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?( \[.*\])?")


@dataclass(frozen=True)
class Table:
    """name: base name of its files. rows: one text per column. bold: (row, column) of the best
    figures. notes: sentences below the table.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    bold: frozenset[tuple[int, int]] = frozenset()
    notes: tuple[str, ...] = ()

    def is_number(self, column: int) -> bool:
        """Whether a column contains numbers, and otherwise only empty texts and dashes."""
        cells = [row[column] for row in self.rows]
        return any(map(_NUMBER.fullmatch, cells)) and all(
            text in ("", "-") or _NUMBER.fullmatch(text) for text in cells
        )

    def text(self) -> str:
        """The table for a terminal; a star marks the best figures."""
        rows = [
            [t + "*" * ((i, j) in self.bold) for j, t in enumerate(row)]
            for i, row in enumerate(self.rows)
        ]
        wrapped = [[wrap(text, _WIDEST) or [""] for text in row] for row in (self.columns, *rows)]
        widths = [
            max(len(line) for lines in column for line in lines)
            for column in zip(*wrapped, strict=True)
        ]
        right = [self.is_number(j) for j in range(len(self.columns))]
        lines = []
        for row in wrapped:
            for texts in zip_longest(*row, fillvalue=""):
                padded = [
                    t.rjust(w) if r else t.ljust(w)
                    for t, w, r in zip(texts, widths, right, strict=True)
                ]
                lines.append("  ".join(padded).rstrip())
        legend = ["A star marks the smallest of each trajectory."] if self.bold else []
        return "\n".join([self.title, *lines, *legend, *self.notes])

    def markdown(self) -> str:
        rows = [
            [f"**{t}**" if (i, j) in self.bold else t for j, t in enumerate(row)]
            for i, row in enumerate(self.rows)
        ]
        rule = ["--:" if self.is_number(j) else ":--" for j in range(len(self.columns))]
        lines = [
            "| " + " | ".join(text.replace("|", r"\|") for text in row) + " |"
            for row in (self.columns, rule, *rows)
        ]
        return "\n".join([f"**{self.title}**", "", *lines, "", *self.notes]).rstrip()

    def latex(self) -> str:
        """A table environment that needs no package.

        Numbers are right-aligned, long texts are set as paragraphs.
        """
        forms = []
        for j in range(len(self.columns)):
            longest = max((len(row[j]) for row in self.rows), default=0)
            forms.append(
                "r" if self.is_number(j) else "l" if longest <= 40 else "p{0.2\\linewidth}"
            )
        lines = [r"\begin{table}", r"\centering", rf"\caption{{{_escaped(self.title)}}}"]
        lines += [rf"\begin{{tabular}}{{{''.join(forms)}}}", r"\hline"]
        lines += [" & ".join(map(_escaped, self.columns)) + r" \\", r"\hline"]
        for i, row in enumerate(self.rows):
            texts = [
                rf"\textbf{{{_escaped(t)}}}" if (i, j) in self.bold else _escaped(t)
                for j, t in enumerate(row)
            ]
            lines.append(" & ".join(texts) + r" \\")
        notes = [rf"\\ {_escaped(note)}" for note in self.notes]
        return "\n".join([*lines, r"\hline", r"\end{tabular}", *notes, r"\end{table}"])

    def csv(self) -> str:
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerows((self.columns, *self.rows))
        return stream.getvalue().removesuffix("\n")


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


#: Format -> (file ending, function that writes a table).
FORMATS: dict[str, tuple[str, Callable[[Table], str]]] = {
    "text": ("txt", Table.text),
    "markdown": ("md", Table.markdown),
    "latex": ("tex", Table.latex),
    "csv": ("csv", Table.csv),
}
