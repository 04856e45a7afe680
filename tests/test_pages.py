"""The pages keep their word: every link leads somewhere, and every command line shown is understood
as it stands.
"""

import re
import shlex

import pytest
from iclnuim.errors import IclnuimError
from iclnuim.headless import cli

#: Pages of which every command line is parsed. Lines that show a choice or a gap (A|B, ...) are
#: prose.
COMMAND_PAGES = (
    "README.md",
    "addon/README.md",
    "trajectories/README.md",
    "blend/README.md",
    "headless/README.md",
    "benchmark/README.md",
)


def pages(repository):
    return [
        page
        for page in sorted(repository.rglob("*.md"))
        if not any(
            part.startswith(".") or part == "node_modules"
            for part in page.relative_to(repository).parts
        )
    ]


def anchors(text):
    """GitHub's anchors of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_relative_link_leads_to_a_file_and_a_heading(repository):
    dead = []
    for page in pages(repository):
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
            if re.match(r"[a-z]+:", link):
                continue
            name, _, anchor = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
                dead.append(f"{page.relative_to(repository)}: {link}")
    assert not dead, "\n".join(dead)


def test_every_guide_and_reference_is_on_the_site_and_on_the_map(repository):
    for place in ("mkdocs.yml", "docs/README.md"):
        text = (repository / place).read_text()
        for folder in ("guide", "reference"):
            for page in (repository / "docs" / folder).glob("*.md"):
                assert f"{folder}/{page.name}" in text, f"{place}: {page.name}"


def test_no_page_has_the_marks_of_a_merge(repository):
    marks = re.compile(r"^(<{7}|>{7}) ", re.M)
    assert [str(page) for page in pages(repository) if marks.search(page.read_text())] == []


def shown_commands(repository):
    """(page, words, whether it stands in a sentence) of each `iclnuim ...` in a code block or a
    code span.
    """
    for name in (
        *COMMAND_PAGES,
        *(str(p.relative_to(repository)) for p in sorted((repository / "docs").rglob("*.md"))),
    ):
        text = (repository / name).read_text()
        # what measured a cell is a command of its commit
        text = re.sub(r"<!-- measured: (.*) -->.*?<!-- end of \1 -->", "", text, flags=re.S)
        blocks = re.findall(r"```sh\n(.*?)```", text, re.S)
        spans = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.S))
        for line in (*"\n".join(blocks).splitlines(), *spans):
            found = re.search(r"(?:^|&& |=\S+ )(?:\.venv/bin/)?iclnuim ([a-z].*)", line)
            if found and not re.search(r"\.\.\.|…", found[1]):
                yield name, shlex.split(found[1], comments=True), line in spans


def parsed(words):
    """Builds the parser of the command and parses the words; nothing is run."""
    return cli.parsed(words[0], words[1:])


def test_every_command_line_on_the_pages_is_understood_with_the_options_of_today(
    repository, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    kt2 = "out/living_room/kt2"
    for folder in ("my_sequence", "DIR", f"{kt2}/clean", f"{kt2}/noisy"):
        (tmp_path / folder).mkdir(parents=True)  # `evaluate FOLDER est.txt` is told by the folder
        (tmp_path / folder / "groundtruth.txt").write_text("0 0 0 0 0 0 0 1\n")
    incomplete = (
        "arguments are required",
        "expected one argument",
    )  # a command in a sentence may name options alone
    wrong = []
    for page, words, in_sentence in shown_commands(repository):
        if words[0] not in cli.COMMANDS:
            wrong.append(f"{page}: {shlex.join(words)}: no such command")
        if words[0] not in cli.COMMANDS or len(words) == 1:
            continue
        try:
            parsed(words)
            said = capsys.readouterr().err
        except (SystemExit, IclnuimError) as error:
            said = f"{capsys.readouterr().err or error}"
        if said and not (in_sentence and any(words in said for words in incomplete)):
            wrong.append(f"{page}: {shlex.join(words)}: {said.strip().splitlines()[-1]}")
    assert not wrong, "\n".join(wrong)


def test_the_page_of_commands_has_them_all(repository):
    text = (repository / "docs/reference/commands.md").read_text()
    assert [name for name in cli.COMMANDS if f"iclnuim {name}" not in text] == []


@pytest.mark.parametrize(
    "name", ["docs", "docs/measured", "tests", "addon", "benchmark", "headless"]
)
def test_folders_have_a_page(repository, name):
    assert (repository / name / "README.md").is_file()


def test_every_page_that_code_names_exists(repository):
    named = set()
    for folder in ("addon", "headless", "benchmark", "tools", "blend", "tests"):
        for path in (repository / folder).rglob("*.py"):
            named |= set(re.findall(r"docs/[\w/]+\.(?:md|csv)", path.read_text()))
    assert len(named) > 10
    assert [page for page in sorted(named) if not (repository / page).is_file()] == []


def test_every_file_that_the_architecture_names_exists(repository):
    text = (repository / "docs/architecture.md").read_text()
    named = set(re.findall(r"`([\w/]+\.(?:py|toml))`", text))
    files: list[str] = []
    for folder in ("addon", "headless", "benchmark", "tools", "blend", "tests"):
        files += map(str, (repository / folder).rglob("*"))
    assert len(named) > 30
    assert [name for name in sorted(named) if not any(f.endswith(f"/{name}") for f in files)] == []


def test_no_text_promises_a_package_index_that_has_iclnuim(repository):
    texts = [*pages(repository)]
    for folder in ("addon", "headless", "benchmark", "tools", "blend"):
        texts += sorted((repository / folder).rglob("*.py"))
    promise = re.compile(r"pip install ['\"]?iclnuim")
    assert [str(path) for path in texts if promise.search(path.read_text())] == []
