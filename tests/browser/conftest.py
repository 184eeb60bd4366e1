"""A studio of its own, and a browser that looks at it and can reach nothing else."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic
from urllib.parse import urlsplit

import pytest

from dechirp.config.loading import parse_settings
from dechirp.experiments.scenario import Scenario, load

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SHOTS = os.environ.get("DECHIRP_SCREENSHOTS")
WITHIN_MS = 120_000  # in a fresh environment, where much is compiled first, on two busy cores

_SOURCES = """(name) => JSON.stringify(
  [...Bokeh.documents[0].get_model_by_name(name).references()]
    .filter((model) => model.type === "ColumnDataSource")
    .map((model) => Object.values(model.data).map((column) => [...column].map(String))))"""

# Decibels of the cell that half of the map stay below: levels run between the ends of the bar.
_MEDIAN_DB = """() => {
  const figure = Bokeh.documents[0].get_model_by_name("range_doppler");
  const models = [...figure.references()];
  const { low, high } = models.find((model) => model.type === "ColorBar").color_mapper;
  const source = models.find((model) => model.data?.image?.[0]);
  const levels = [...source.data.image[0]].sort((a, b) => a - b);
  return low + (high - low) * levels[levels.length >> 1] / 255;
}"""

# What stands in an element, and in the widgets in it.
_TEXT = """(selector) => {
  const text = (node) => node.nodeName === "STYLE" ? "" : node.data
    ?? [...node.childNodes, ...node.shadowRoot?.childNodes ?? []].map(text).join("");
  return text(document.querySelector(selector)).trim();
}"""

# Where a place of a figure lies on the screen.
_ON_SCREEN = """([name, x, y]) => {
  const model = Bokeh.documents[0].get_model_by_name(name);
  const within = (view) => view.model === model ? view : view.children().map(within).find(Boolean);
  const view = Object.values(Bokeh.index).map(within).find(Boolean);
  const box = view.el.getBoundingClientRect(), { x_scale, y_scale } = view.frame;
  return [box.x + x_scale.compute(x), box.y + y_scale.compute(y)];
}"""

# The name of what has the focus, inside of a widget where it is there.
_FOCUSED = """() => {
  let at = document.activeElement;
  while (at.shadowRoot?.activeElement) at = at.shadowRoot.activeElement;
  return at.getRootNode().host?.dataset.setting ?? at.textContent.trim();
}"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    """What the studio may open: a scenario, and a recording of it."""
    made = tmp_path_factory.mktemp("recordings")
    scenario = made / "street.yaml"
    shutil.copyfile(Path(__file__).parent / "street.yaml", scenario)
    call = [sys.executable, "-m", "dechirp", "convert", str(scenario), str(made / "street.npz")]
    subprocess.run([*call, "--quiet"], check=True)
    return made


@pytest.fixture(scope="module")
def browser():
    """Of one module alone: Playwright holds the loop of its thread, which other tests need."""
    pytest.importorskip("bokeh")
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium here: install it, or name it in CHROMIUM")
    with sync_api.sync_playwright() as made:
        launched = made.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def address(browser, folder) -> Iterator[str]:
    call = [sys.executable, "-m", "dechirp", "studio", str(folder), "--port", "0", "--json"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield json.loads(server.stdout.readline())["address"]
        finally:
            server.terminate()
            server.wait(30)


class Looked:
    """A page, with what it asked for elsewhere and what went wrong in it."""

    def __init__(self, context, address: str) -> None:
        self.context, self.address, self.outside, self.errors = context, address, [], []
        context.route("**/*", self._only_here)
        self.page = context.new_page()
        self.page.set_default_timeout(WITHIN_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._heard)

    def _only_here(self, route) -> None:
        if urlsplit(route.request.url).netloc == urlsplit(self.address).netloc:
            route.continue_()
        else:
            self.outside.append(route.request.url)
            route.abort()

    def _heard(self, message) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def go(self, path: str = "") -> "Looked":
        self.page.goto(self.address + path)
        self.until(lambda: self.frames > 0)
        return self

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait; Playwright's own way needs eval in the page, which is forbidden there."""
        give_up = monotonic() + WITHIN_MS / 1000
        while not holds():
            assert monotonic() < give_up, "it never came"
            self.page.wait_for_timeout(50)

    @property
    def frames(self) -> int:
        """Drawn so far."""
        return self.page.evaluate("() => window.dechirp?.ready ? window.dechirp.frames : 0")

    @property
    def place(self) -> str:
        return self.page.locator("#place").text_content()

    @property
    def median_db(self) -> float:
        return self.page.evaluate(_MEDIAN_DB)

    @property
    def focused(self) -> str:
        return self.page.evaluate(_FOCUSED)

    @property
    def settings(self) -> Scenario:
        """In force, as the text that is copied and downloaded has them."""
        call = """() => [...Bokeh.documents[0].get_model_by_name("settings_file").references()]
          .find((model) => model.type === "TextAreaInput").tags[0]"""
        return parse_settings(self.page.evaluate(call), Scenario)

    def drawn_after(self, act: Callable[[], object]) -> None:
        """Do something, and wait until another frame was drawn."""
        before = self.frames
        act()
        self.until(lambda: self.frames > before)

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).locator("visible=true").click()

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def knob(self, path: str):
        """What is typed or chosen into, of a setting on the tab that is open."""
        return self.page.locator(f'[data-setting="{path}"] :is(input, select):visible')

    def type(self, path: str, text: str) -> None:
        self.knob(path).fill(text)
        self.knob(path).press("Enter")

    def title(self, name: str) -> str:
        """Of a figure."""
        call = "(name) => Bokeh.documents[0].get_model_by_name(name).title.text"
        return self.page.evaluate(call, name)

    def text(self, selector: str) -> str:
        return self.page.evaluate(_TEXT, selector)

    def data(self, name: str) -> str:
        """All that the figures below a root draw."""
        return self.page.evaluate(_SOURCES, name)

    def on_screen(self, name: str, x: float, y: float) -> tuple[float, float]:
        return tuple(self.page.evaluate(_ON_SCREEN, [name, x, y]))

    def download(self, file: Path) -> Scenario:
        """Settings as the page lets one download them, read as the command line does."""
        self.tab("File")
        with self.page.expect_download() as told:
            self.press("Download")
        told.value.save_as(file)
        return load(file)

    @property
    def grounds(self) -> list[str]:
        """Colour that a map lies on, and that of the page about it."""
        call = """() => {
          const of = Bokeh.documents[0].get_model_by_name("range_doppler").border_fill_color;
          const page = getComputedStyle(document.documentElement).getPropertyValue("--tile");
          return [of?.value ?? of, page.trim()];
        }"""
        return self.page.evaluate(call)

    def shot(self, name: str) -> None:
        """Keep a picture, where somebody wants to look at it."""
        if SHOTS:
            Path(SHOTS).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=Path(SHOTS) / f"{name}.png")


@pytest.fixture(params=["1280x720"])
def looked(request, browser, address) -> Iterator[Looked]:
    width, height = re.findall(r"\d+", request.param)
    context = browser.new_context(viewport={"width": int(width), "height": int(height)})
    made = Looked(context, address)
    yield made
    context.close()
    assert made.outside == []
    assert made.errors == []
