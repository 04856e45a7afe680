"""The report: one file that needs no other, and in a real browser sorts, filters, opens its cells
and obeys the keyboard.
"""

import json
import re
from html.parser import HTMLParser

import pytest
from browser import Browser, program
from iclnuim.benchmark.experiments.page import MAX_BYTES, Page
from iclnuim.errors import WorkError
from iclnuim.headless import cli
from made_up import only, result, results, written

#: A JPEG of one pixel will do for a picture.
PIXEL = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffd9")
browser_only = pytest.mark.skipif(program() is None, reason="needs Chromium: apt install chromium")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Of 18 cells, one of them with a picture, one failed."""
    out = tmp_path_factory.mktemp("report")
    found = [
        *only(results(4), room="living_room", trajectory="kt0"),
        *only(results(4), room="office", odometer="fovis", trajectory="kt0"),
    ]
    found[-1] = result(found[-1].key, 0.1, failed="no <b>frame</b> could be tracked")
    written(out, found)
    (out / "cells" / found[0].key.place / "heat.jpg").write_bytes(PIXEL)
    assert cli.main(["benchmark", "--report-only", "--out", str(out), "--quiet"]) == 0
    return out / "report.html"


class Tags(HTMLParser):
    """Which elements are open at the end, and where the page would load anything from."""

    ALONE = ("meta", "input", "br", "wbr", "img")

    def __init__(self):
        super().__init__()
        self.open, self.loads = [], []

    def handle_starttag(self, tag, attrs):
        self.loads += [
            value
            for name, value in attrs
            if name in ("src", "srcset") or (name == "href" and tag == "link")
        ]
        if tag not in self.ALONE:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_it_is_one_well_formed_file_that_loads_nothing(report):
    text, tags = report.read_text(), Tags()
    tags.feed(text)
    assert (
        tags.open == []
        and all(address.startswith("data:image/png;base64,") for address in tags.loads)
        and "http" not in re.sub(r"http://www\.w3\.org/\S+", "", text)
    )
    assert "{{" not in text and len(text) < 60e6
    data = json.loads(
        re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1]
    )
    assert len(data["cells"]) == 18 and data["cells"][0]["heat_jpg"].startswith("data:image/jpeg")
    assert {"dvo", "fovis", "rgbd", "icp", "icp_rgbd"} == set(data["colours"])


def test_it_begins_with_the_best_method_of_each_condition_and_a_chart(report):
    text = report.read_text()
    headings = re.findall("<h2>(.*?)</h2>", text)
    assert headings[0] == "Which method for which condition"
    section = text[text.index('id="best"') : text.index("</section>")]
    assert section.count("<img ") == 1 and "living room, clean" in section


def test_what_failed_is_said_and_does_not_become_markup(report):
    assert "<b>frame</b>" not in report.read_text() and "no \\u003cb>frame" in report.read_text()


@pytest.mark.slow
def test_pictures_beyond_the_limit_are_left_out(report, monkeypatch):
    from iclnuim.benchmark.experiments.recipes.paper import page as paper_page

    monkeypatch.setattr(paper_page, "_PICTURES", 10)
    assert cli.main(["benchmark", "--report-only", "--out", str(report.parent), "--quiet"]) == 0
    assert "data:image/jpeg" not in report.read_text()
    monkeypatch.undo()
    assert cli.main(["benchmark", "--report-only", "--out", str(report.parent), "--quiet"]) == 0
    assert "data:image/jpeg" in report.read_text()


ROWS = "[...document.querySelectorAll('#all tbody tr:not(.open)')]"


@pytest.mark.slow
@browser_only
def test_in_a_browser_it_sorts_filters_and_opens(report, tmp_path):
    with Browser(tmp_path, 1300, 900) as page:
        page.open(report)
        assert page.value(f"{ROWS}.length") == 18
        names = page.value("[...document.querySelectorAll('#all th')].map(th => th.textContent)")
        column = names.index("ATE mm")
        for order, sort in (
            ("ascending", sorted),
            ("descending", lambda values: sorted(values, reverse=True)),
        ):
            page.value(f"document.querySelectorAll('#all th button')[{column}].click()")
            ate = page.value(f"{ROWS}.map(row => +row.children[{column}].textContent)")
            assert ate == sort(ate) and len(set(ate)) > 1
            assert page.value(f"document.querySelectorAll('#all th')[{column}].ariaSort") == order
        page.value("document.getElementById('search').value = 'kt0 icp_rgbd'")
        page.value("document.getElementById('search').dispatchEvent(new Event('input'))")
        assert page.value(f"{ROWS}.length") == 4 and "4 of 18" in page.value(
            "document.getElementById('count').textContent"
        )
        page.value(f"{ROWS}[0].querySelector('button').click()")
        lines = page.value("document.querySelectorAll('tr.open svg polyline').length")
        assert lines == 3 and page.value("document.querySelectorAll('tr.open dt').length") > 8
        assert page.value("document.querySelectorAll('#chart circle').length") == 16


@pytest.mark.slow
@browser_only
def test_the_keyboard_reaches_and_works_everything(report, tmp_path):
    focused, seen = "document.activeElement", []
    with Browser(tmp_path, 1300, 900) as page:
        page.open(report)
        for _ in range(60):
            page.press("Tab")
            seen.append(page.value(f"{focused}.tagName + ' ' + {focused}.textContent.slice(0, 40)"))
            if page.value(f"{focused}.getAttribute('aria-expanded')") == "false":
                break
        assert any(tag.startswith("INPUT") for tag in seen) and any(
            tag.startswith("SELECT") for tag in seen
        )
        assert any(tag.startswith("SUMMARY Table III") for tag in seen) and "BUTTON ATE mm" in seen
        assert page.value(f"getComputedStyle({focused}).outlineStyle") == "solid"
        page.press("Enter")
        assert page.value(f"{focused}.getAttribute('aria-expanded')") == "true"
        assert page.value("document.querySelectorAll('tr.open').length") == 1


@pytest.mark.slow
@browser_only
def test_on_a_phone_and_on_paper_nothing_is_cut_off(report, tmp_path):
    with Browser(tmp_path, 390, 844) as page:
        page.open(report)
        assert page.value("document.documentElement.scrollWidth") <= 390
        page.value(f"{ROWS}[0].querySelector('button').click()")
        wide = "document.querySelector('.cell').getBoundingClientRect()"
        assert page.value(f"{wide}.left") >= 0 and page.value(f"{wide}.right") <= 390
        assert page.value("document.querySelector('#all').getBoundingClientRect().width") <= 390
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.value("getComputedStyle(document.querySelector('form')).display") == "none"
        page.value("dispatchEvent(new Event('beforeprint'))")
        assert page.value("[...document.querySelectorAll('details')].every(one => one.open)")
        assert len(page.call("Page.printToPDF")["data"]) > 20_000


def test_a_page_that_no_browser_opens_is_not_written(tmp_path):
    whole = Page("all", "", [], data={"a": "x" * (MAX_BYTES - 1_000_000)}).write(
        tmp_path / "a.html"
    )
    assert whole.stat().st_size < MAX_BYTES
    with pytest.raises(WorkError, match="would have 61 MB, but the limit is 60 MB"):
        Page("all", "", [], data={"a": "x" * (MAX_BYTES + 1_000_000)}).write(tmp_path / "b.html")
    assert not (tmp_path / "b.html").exists()
