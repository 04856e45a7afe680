"""What MkDocs is told about this checkout (mkdocs.yml): README and the pages of the folders are on
the site too, links between them and docs/ hold, and every public name is in the reference.
"""

import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[1]
#: Where mkdocstrings finds the package: its folders as they lie when it is installed.
PACKAGE = REPOSITORY / "out/site_package/iclnuim"
#: Files of examples/ that become pages.
EXAMPLES = (".py", ".ipynb")
#: Pages that a search lists below those of users.
OF_DEVELOPERS = ("measured/", "architecture", "CONTRIBUTING", "CHANGELOG", "tests/", "benchmark/")
#: Share of white pixels above which a picture is a chart.
CHART_WHITE = 0.35
#: The front page's pictures of clean and noisy depth, one above the other.
SLIDER = """<div class="slider" style="--at: 50%">
<div class="clean" role="img" aria-label="Exact depth of the living room"></div>
<div class="noisy" role="img" aria-label="The same with the noise of a sensor"></div>
<span class="named">exact depth</span><span class="named right">with a sensor's noise</span>
<input type="range" min="0" max="100" value="50" aria-label="How much of the picture is exact">
</div>"""
#: What the site has besides docs/.
BESIDE = (
    "*.md",
    "CITATION.cff",
    "pyproject.toml",
    "addon/README.md",
    "benchmark/README.md",
    "blend/README.md",
    "blend/pictures/*",
    "examples/*.*",
    "examples/pictures/*",
    "headless/README.md",
    "tests/README.md",
    "trajectories/README.md",
    "trajectories/*/*.png",
)


def on_startup(**_: Any) -> None:
    """Lay out the package."""
    shutil.rmtree(PACKAGE, ignore_errors=True)
    PACKAGE.mkdir(parents=True)
    for path in (REPOSITORY / "addon/iclnuim").iterdir():
        (PACKAGE / path.name).symlink_to(path)
    (PACKAGE / "benchmark").symlink_to(REPOSITORY / "benchmark")


def on_config(config: MkDocsConfig) -> None:
    """Add the pages of the public names, the scripts of examples, and what was measured."""
    sections: dict[str, list[Any]] = {}
    for section in config.nav or []:
        sections |= section
    sections["Reference"].append({"Python": [python_page(title) for title in public_names()]})
    measured = {f"measured/{page.name}" for page in REPOSITORY.glob("docs/measured/*.md")}
    of_developers = next(one for one in sections["Developers"] if "Measured" in one)["Measured"]
    of_developers += sorted(measured - {*of_developers, *sections["Results"]})
    for path in sorted(REPOSITORY.glob("examples/*")):
        if path.suffix in EXAMPLES:
            sections["Examples"].append(site_place(f"examples/{path.name}"))


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add what lies beside docs/, and a page for every group of public names."""
    files.remove(files.src_uris["README.md"])
    add(files, config, "docs/README.md")
    for pattern in BESIDE:
        for path in sorted(REPOSITORY.glob(pattern)):
            add(files, config, path.relative_to(REPOSITORY).as_posix())
    for title, names in public_names().items():
        text = "\n\n".join([f"# {title}", *(f"::: iclnuim.{name}" for name in names)])
        files.append(File.generated(config, python_page(title), content=text))


def add(files: Files, config: MkDocsConfig, path: str) -> None:
    """Add one file of the checkout; a script or notebook becomes a page."""
    source = REPOSITORY / path
    if source.suffix in EXAMPLES:
        text = "\n\n".join([f"# {source.name}", *example_parts(source)])
        files.append(File.generated(config, site_place(path), content=text))
    else:
        files.append(File.generated(config, site_place(path), abs_src_path=str(source)))


def example_parts(source: Path) -> Iterator[str]:
    """The code of a script, or the cells of a notebook and what they give, as Markdown."""
    text = source.read_text("utf-8")
    cells: list[dict[str, Any]] = [{"cell_type": "code", "source": [text]}]
    if source.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
    for cell in cells:
        content = "".join(cell["source"]).strip()
        if cell["cell_type"] == "code":
            content = f"```python\n{content}\n```"
        yield content
        for output in cell.get("outputs", ()):
            yield output_part(output)


def output_part(output: dict[str, Any]) -> str:
    """What a cell of a notebook gave: a picture, a table or a text."""
    data = output.get("data", {"text/plain": output.get("text", "")})
    if "image/png" in data:
        return f'<img class="chart" alt="output" src="data:image/png;base64,{data["image/png"].strip()}">'
    if "text/html" in data:
        return f"<div>{''.join(data['text/html']).strip()}</div>"
    return f"```text\n{''.join(data['text/plain']).strip()}\n```"


def on_page_markdown(markdown: str, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Turn links within the checkout into links within the site, comments behind commands into
    lines above them, and mark what is drawn on white.
    """
    here = page.file.src_uri
    origin = checkout_place(here)
    if here.startswith(OF_DEVELOPERS):
        page.meta["search"] = {"boost": 0.3}
    if here == "guide/view.md":
        page.meta["search"] = {"boost": 2}
    if here == "README.md":
        markdown = re.sub(r"!\[[^\]]*\]\(docs/pictures/living_room.jpg\)", SLIDER, markdown)
    markdown = re.sub(r"(?ms)^```sh\n.*?^```$", comments_above, markdown)
    markdown = re.sub(
        r"!\[[^\[\]]*\]\(([^)#\s]+)\)",
        lambda image: image[0] + marked(REPOSITORY / Path(origin).parent / image[1]),
        markdown,
    )

    def turned(link: re.Match[str]) -> str:
        text, target = link.groups()
        if ":" in target:
            return link[0]
        path = os.path.normpath(PurePosixPath(origin).parent / target)
        place = os.path.relpath(site_place(path), PurePosixPath(here).parent)
        return f"[{link_text(text, path)}]({place}"

    return re.sub(r"\[([^\[\]]*)\]\(([^)#\s]+)", turned, markdown)


def comments_above(block: re.Match[str]) -> str:
    """A block of commands whose comments stand on lines of their own, so that none is cut."""
    return re.sub(r"(?m)^(\S.*?) +# (.*)$", r"# \2\n\1", block[0])


def marked(picture: Path) -> str:
    """The class of a chart, which pages of dark colours invert; none for photographs."""
    if picture.suffix == ".svg":
        return "{ .chart }"
    if picture.suffix != ".png":
        return ""
    histogram = Image.open(picture).convert("L").histogram()
    return "{ .chart }" if sum(histogram[245:]) > CHART_WHITE * sum(histogram) else ""


def link_text(text: str, path: str) -> str:
    """The title of the page in place of the name of its file."""
    if not re.fullmatch(r"[\w/]+(\.md|/)", text) or not path.endswith(".md"):
        return text
    first = (REPOSITORY / path).read_text("utf-8").partition("\n")[0]
    return first.removeprefix("# ")


def site_place(path: str) -> str:
    """Where a file of the checkout is on the site."""
    if path == "docs/README.md":
        return "map.md"
    if path.startswith("examples/") and path.endswith(EXAMPLES):
        return f"{path}.md"
    return path.removeprefix("docs/")


def checkout_place(place: str) -> str:
    """The file of the checkout that is at this place of the site."""
    if place == "map.md":
        return "docs/README.md"
    if place != "README.md" and (REPOSITORY / "docs" / place).is_file():
        return f"docs/{place}"
    return place


def python_page(title: str) -> str:
    """The page of a group of public names."""
    return f"reference/python/{re.sub(r'[^a-z]+', '_', title.lower())}.md"


def public_names() -> dict[str, list[str]]:
    """The public names by the groups in which `iclnuim/__init__.py` lists them."""
    source = (REPOSITORY / "addon/iclnuim/__init__.py").read_text("utf-8")
    listed = source.partition("__all__ = [")[2].partition("]")[0]
    groups = {}
    for group in re.split(r"\n    # ", f"\n    # errors{listed}")[1:]:
        title, _, names = group.partition("\n")
        groups[title[0].upper() + title[1:]] = re.findall(r'"([A-Za-z]\w*)"', names)
    return groups
