"""Pages of the built guide, opened from disk without network access.

By default a page of each kind opens, and all formulas are typeset on one page; at night all open.
"""

import os
import re
import zlib
from pathlib import Path

import pytest

import dechirp
from nightly import nightly, nightly_except
from test_api import NAMESPACES, ROOT_NAMES

GUIDE = Path(os.environ.get("DECHIRP_GUIDE") or "/nowhere")
ALL_PAGES = sorted(page.relative_to(GUIDE) for page in GUIDE.rglob("*.html"))
PAGES = [page.as_posix() for page in ALL_PAGES if page.parts[0] != "_static"] or ["index.html"]
PAGES_OF_EACH_KIND = (
    "index.html",
    "angles.html",
    "api/theory.html",
    "gallery_built/index.html",
    "gallery_built/velocity/plot_rotor.html",
    "guide/phase-2-range.html",
)
pytestmark = pytest.mark.skipif(
    not (GUIDE / "index.html").is_file(),
    reason="no built guide: build it and set DECHIRP_GUIDE to its folder",
)

# Resources that a page loads automatically; links for readers are excluded.
EXTERNAL_RESOURCE = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*\bsrc=["']?(?:https?:)?//[^"'> ]*"""
    r"""|<link\b(?=[^>]*rel=["']?(?:stylesheet|preload|icon|preconnect))[^>]*"""
    r"""href=["']?(?:https?:)?//[^"'> ]*"""
)
EXTERNAL_CSS_RESOURCE = re.compile(
    r"""url\(\s*["']?(?:https?:)?//[^)]*|@import\s+["'](?:https?:)?//"""
)

IMAGE = re.compile(r"""<img\b[^>]*\bsrc="([^"#?]+)""")

# Formulas that were not typeset, and images that did not load.
UNTYPESET_FORMULAS_JS = """() => [...document.querySelectorAll(".math")]
  .filter((one) => !one.querySelector("mjx-container")).map((one) => one.textContent)"""
BROKEN_IMAGES_JS = """() => [...document.images]
  .filter((one) => one.complete && !one.naturalWidth).map((one) => one.src)"""
WAIT_FOR_TYPESETTING_JS = (
    "() => window.MathJax?.startup?.promise ? MathJax.startup.promise.then(() => true) : true"
)
TYPESET_FORMULAS_JS = """(pages) => {
  const container = document.body.appendChild(document.createElement("div"));
  for (const page of pages)
    container.append(...new DOMParser().parseFromString(page, "text/html")
      .querySelectorAll(".math"));
  return MathJax.typesetPromise([container]).then(() => container.childElementCount);
}"""
HAS_SEARCH_RESULTS_JS = "() => document.querySelectorAll('#search-results li a').length > 0"


class GuidePage:
    """Page from disk that records external requests and errors."""

    def __init__(self, browser) -> None:
        self.context, self.external_urls, self.errors = browser.new_context(), [], []
        self.context.route("**/*", self._block_network_requests)
        self.page = self.context.new_page()
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._record_console_error)

    def _block_network_requests(self, route) -> None:
        if route.request.url.startswith(("file:", "data:", "blob:")):
            route.continue_()
        else:
            self.external_urls.append(route.request.url)
            route.abort()

    def _record_console_error(self, message) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def open(self, page: str) -> None:
        self.external_urls.clear()
        self.errors.clear()
        self.page.goto(f"file://{GUIDE.resolve()}/{page}", wait_until="load", timeout=120_000)


@pytest.fixture(scope="module")
def guide_page(browser):
    guide_page = GuidePage(browser)
    yield guide_page
    guide_page.context.close()


@pytest.mark.parametrize("page", nightly_except(PAGES_OF_EACH_KIND, PAGES))
def test_page_opens_completely_from_disk(guide_page, page):
    guide_page.open(page)
    guide_page.page.evaluate(WAIT_FOR_TYPESETTING_JS)

    assert guide_page.page.evaluate(UNTYPESET_FORMULAS_JS) == []
    assert guide_page.page.evaluate(BROKEN_IMAGES_JS) == []
    assert guide_page.external_urls == []
    assert guide_page.errors == []


@nightly
def test_formulas_of_all_pages_are_typeset(guide_page):
    texts = [(GUIDE / page).read_text(encoding="utf-8") for page in PAGES]
    with_formulas = [text for text in texts if 'class="math' in text]
    guide_page.open("guide/phase-2-range.html")
    guide_page.page.evaluate(WAIT_FOR_TYPESETTING_JS)

    n_formulas = guide_page.page.evaluate(TYPESET_FORMULAS_JS, with_formulas)

    assert n_formulas >= len(with_formulas) > 1
    assert guide_page.page.evaluate(UNTYPESET_FORMULAS_JS) == []
    assert guide_page.errors == []


def test_images_of_all_pages_exist():
    missing = {
        (page, source)
        for page in PAGES
        for source in IMAGE.findall((GUIDE / page).read_text(encoding="utf-8"))
        if not source.startswith("data:") and not (GUIDE / page).parent.joinpath(source).is_file()
    }
    assert missing == set()


def test_search_finds_page(guide_page):
    guide_page.open("search.html?q=ordered+statistic")
    guide_page.page.wait_for_function(HAS_SEARCH_RESULTS_JS, timeout=120_000)

    assert guide_page.external_urls == []
    assert guide_page.errors == []


def test_pages_load_no_external_resources():
    for page in PAGES:
        text = (GUIDE / page).read_text(encoding="utf-8")
        assert EXTERNAL_RESOURCE.findall(text) == [], page
    for sheet in GUIDE.rglob("*.css"):
        assert EXTERNAL_CSS_RESOURCE.findall(sheet.read_text(encoding="utf-8")) == [], sheet


def test_inventory_contains_every_public_name():
    """Check objects.inv of Sphinx: four header lines, then compressed lines."""
    *_, compressed = (GUIDE / "objects.inv").read_bytes().split(b"\n", 4)
    lines = zlib.decompress(compressed).decode().splitlines()
    documented_names = {line.split()[0] for line in lines if line.split()[1].startswith("py:")}

    members = {
        f"{namespace}.{name}"
        for namespace in NAMESPACES
        for name in getattr(dechirp, namespace).__all__
    }
    assert {f"dechirp.{name}" for name in (*ROOT_NAMES, *members)} <= documented_names
