"""One self-contained HTML page for every experiment, from the template page.html."""

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iclnuim.errors import WorkError
from iclnuim.formats.files import atomic_write_text
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from .table import ResultTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest size of a page, so that a browser opens it.
MAX_BYTES = 60_000_000


@dataclass(frozen=True)
class Section:
    """A heading with a text and tables. part: "chart" or "cells", what the page's script draws
    there. folded: each table opens with a click; open_first: the first one is open. picture: a
    chart before the tables, as a data URI. drawn: the same as HTML.
    """

    id: str
    heading: str
    text: str = ""
    tables: Sequence[ResultTable] = ()
    part: str = ""
    folded: bool = False
    open_first: bool = False
    picture: str = ""
    drawn: Markup | str = ""


@dataclass(frozen=True)
class Page:
    """tiles: (number, text) at the top. data: what the page's script draws, as JSON. heat: CSS
    gradient of its pictures.
    """

    title: str
    lead: str
    sections: Sequence[Section]
    tiles: Sequence[tuple[str, str]] = ()
    data: Mapping[str, Any] | None = None
    heat: str = "none"

    def write(self, file: Path) -> Path:
        """Raises WorkError if it cannot be written or is too large."""
        data = ""
        if self.data is not None:
            # a script ends at the first tag in it
            text = json.dumps(self.data, separators=(",", ":"), sort_keys=True)
            data = Markup(text.replace("<", "\\u003c"))
        page = _template().render({**vars(self), "data": data})
        size = len(page.encode())
        if size > MAX_BYTES:
            limit = f"the limit is {MAX_BYTES / 1e6:.0f} MB"
            raise WorkError(f"{file}: the page would have {size / 1e6:.0f} MB, but {limit}")
        atomic_write_text(file, page)
        return file


def png_uri(figure: "Figure", dpi: int = 110) -> str:
    """A chart as the data URI of a PNG."""
    chart = io.BytesIO()
    figure.savefig(chart, format="png", dpi=dpi)
    return f"data:image/png;base64,{base64.b64encode(chart.getvalue()).decode()}"


@cache
def _template() -> Any:
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(
        loader=loader,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template("page.html")
