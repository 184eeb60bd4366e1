"""The guide as a reader opens it: from disk, without a network."""

import os
import re
import zlib
from pathlib import Path

import pytest

import dechirp

GUIDE = Path(os.environ.get("DECHIRP_GUIDE") or "/nowhere")
EVERY = sorted(page.relative_to(GUIDE) for page in GUIDE.rglob("*.html"))
PAGES = [str(page) for page in EVERY if page.parts[0] != "_static"] or ["index.html"]
pytestmark = pytest.mark.skipif(
    not (GUIDE / "index.html").is_file(), reason="DECHIRP_GUIDE names no guide that was built"
)

# What a page fetches by itself; links that a reader may follow are others' business.
FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*\bsrc=["']?(?:https?:)?//[^"'> ]*"""
    r"""|<link\b(?=[^>]*rel=["']?(?:stylesheet|preload|icon|preconnect))[^>]*"""
    r"""href=["']?(?:https?:)?//[^"'> ]*"""
)
FETCHED_BY_CSS = re.compile(r"""url\(\s*["']?(?:https?:)?//[^)]*|@import\s+["'](?:https?:)?//""")

# Formulas that are still as they were typed, and pictures that did not load.
UNSET = """() => [...document.querySelectorAll(".math")]
  .filter((one) => !one.querySelector("mjx-container")).map((one) => one.textContent)"""
BROKEN = """() => [...document.images]
  .filter((one) => one.complete && !one.naturalWidth).map((one) => one.src)"""
TYPESET = "() => window.MathJax?.startup?.promise ? MathJax.startup.promise.then(() => true) : true"
FOUND = "() => document.querySelectorAll('#search-results li a').length > 0"


class Opened:
    """A page from disk, with what it asked for elsewhere and what went wrong in it."""

    def __init__(self, browser) -> None:
        self.context, self.outside, self.errors = browser.new_context(), [], []
        self.context.route("**/*", self._only_from_disk)
        self.page = self.context.new_page()
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._heard)

    def _only_from_disk(self, route) -> None:
        if route.request.url.startswith(("file:", "data:", "blob:")):
            route.continue_()
        else:
            self.outside.append(route.request.url)
            route.abort()

    def _heard(self, message) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def go(self, page: str) -> None:
        self.outside.clear()
        self.errors.clear()
        self.page.goto(f"file://{GUIDE.resolve()}/{page}", wait_until="load", timeout=120_000)


@pytest.fixture(scope="module")
def opened(browser):
    made = Opened(browser)
    yield made
    made.context.close()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_opens_whole_from_disk(opened, page):
    opened.go(page)
    opened.page.evaluate(TYPESET)

    assert opened.page.evaluate(UNSET) == []
    assert opened.page.evaluate(BROKEN) == []
    assert opened.outside == []
    assert opened.errors == []


def test_search_finds_a_page(opened):
    opened.go("search.html?q=ordered+statistic")
    opened.page.wait_for_function(FOUND, timeout=120_000)

    assert opened.outside == []
    assert opened.errors == []


def test_no_page_fetches_anything_from_elsewhere():
    for page in PAGES:
        text = (GUIDE / page).read_text(encoding="utf-8")
        assert FETCHED.findall(text) == [], page
    for sheet in GUIDE.rglob("*.css"):
        assert FETCHED_BY_CSS.findall(sheet.read_text(encoding="utf-8")) == [], sheet


def test_the_api_has_every_name_of_the_package():
    """As other projects' guides read it: four lines, then compressed ones."""
    *_, packed = (GUIDE / "objects.inv").read_bytes().split(b"\n", 4)
    lines = zlib.decompress(packed).decode().splitlines()
    told = {line.split()[0] for line in lines if line.split()[1].startswith("py:")}

    members = {
        f"{namespace}.{name}"
        for namespace in dechirp._NAMESPACES
        for name in getattr(dechirp, namespace).__all__
    }
    assert {f"dechirp.{name}" for name in (*dechirp.__all__, *members)} <= told
