"""Fixtures of browser tests: a studio server, and a browser without other network access."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from urllib.parse import urlsplit

import pytest

from dechirp.cli.main import main
from dechirp.config.loading import parse_settings
from dechirp.experiments.scenario import Scenario, load

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
SCREENSHOT_FOLDER = os.environ.get("DECHIRP_SCREENSHOTS")
TIMEOUT_MS = 120_000  # a fresh environment compiles first, on two busy cores

_SOURCE_COLUMNS_JS = """(name) => JSON.stringify(
  [...Bokeh.documents[0].get_model_by_name(name).references()]
    .filter((model) => model.type === "ColumnDataSource")
    .map((model) => Object.values(model.data).map((column) => [...column].map(String))))"""

# Median of the map in dB: levels span the range of the colour bar.
_MEDIAN_DB_JS = """() => {
  const figure = Bokeh.documents[0].get_model_by_name("range_doppler");
  const models = [...figure.references()];
  const { low, high } = models.find((model) => model.type === "ColorBar").color_mapper;
  const source = models.find((model) => model.data?.image?.[0]);
  const levels = [...source.data.image[0]].sort((a, b) => a - b);
  return low + (high - low) * levels[levels.length >> 1] / 255;
}"""

# Text of an element, including the widgets inside it.
_TEXT_JS = """(selector) => {
  const text = (node) => node.nodeName === "STYLE" ? "" : node.data
    ?? [...node.childNodes, ...node.shadowRoot?.childNodes ?? []].map(text).join("");
  return text(document.querySelector(selector)).trim();
}"""

# Screen position of a point of a figure.
_SCREEN_POSITION_JS = """([name, x, y]) => {
  const model = Bokeh.documents[0].get_model_by_name(name);
  const within = (view) => view.model === model ? view : view.children().map(within).find(Boolean);
  const view = Object.values(Bokeh.index).map(within).find(Boolean);
  const box = view.el.getBoundingClientRect(), { x_scale, y_scale } = view.frame;
  return [box.x + x_scale.compute(x), box.y + y_scale.compute(y)];
}"""

# Name of the focused element, also inside widgets.
_FOCUSED_NAME_JS = """() => {
  let at = document.activeElement;
  while (at.shadowRoot?.activeElement) at = at.shadowRoot.activeElement;
  return at.getRootNode().host?.dataset.setting ?? at.textContent.trim();
}"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    """Create the folder of the studio: a scenario, and a recording of it."""
    recordings = tmp_path_factory.mktemp("recordings")
    scenario = recordings / "street.yaml"
    shutil.copyfile(Path(__file__).parent / "street.yaml", scenario)
    with pytest.raises(SystemExit) as end:
        main(["convert", str(scenario), str(recordings / "street.npz"), "--quiet"])
    assert end.value.code == 0
    return recordings


@pytest.fixture(scope="module")
def browser():
    """Launch Chromium per module: Playwright occupies the event loop that other tests need."""
    pytest.importorskip("bokeh")
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("Chromium not found: install it, or set CHROMIUM to its path")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def studio_address(folder) -> Iterator[str]:
    """Start the studio once: it imports and compiles for seconds."""
    call = [sys.executable, "-m", "dechirp", "studio", str(folder), "--port", "0", "--json"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield json.loads(server.stdout.readline())["address"]
        finally:
            server.terminate()
            server.wait(30)


@pytest.fixture(scope="module")
def address(request, browser) -> str:
    """Return the address of the studio, which starts after the browser if there is one."""
    return request.getfixturevalue("studio_address")


def is_apart(box: dict[str, float], other: dict[str, float]) -> bool:
    """Check that two boxes of the page do not overlap."""
    return (
        box["x"] + box["width"] <= other["x"]
        or other["x"] + other["width"] <= box["x"]
        or box["y"] + box["height"] <= other["y"]
        or other["y"] + other["height"] <= box["y"]
    )


class LivePage:
    """Page of the studio that records external requests and errors."""

    def __init__(self, context, address: str) -> None:
        self.context, self.address, self.external_urls, self.errors = context, address, [], []
        context.route("**/*", self._block_external_requests)
        self.page = context.new_page()
        self.page.set_default_timeout(TIMEOUT_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._record_console_error)

    def _block_external_requests(self, route) -> None:
        if urlsplit(route.request.url).netloc == urlsplit(self.address).netloc:
            route.continue_()
        else:
            self.external_urls.append(route.request.url)
            route.abort()

    def _record_console_error(self, message) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def open(self, path: str = "") -> "LivePage":
        self.page.goto(self.address + path)
        self.wait_until(lambda: self.n_frames > 0)
        return self

    def wait_until(self, holds: Callable[[], bool]) -> None:
        """Wait by polling: wait_for_function of Playwright needs eval, which the page forbids."""
        give_up = monotonic() + TIMEOUT_MS / 1000
        while not holds():
            assert monotonic() < give_up, "condition not met in time"
            self.page.wait_for_timeout(50)

    @property
    def n_frames(self) -> int:
        """Number of frames drawn."""
        return self.page.evaluate("() => window.dechirp?.ready ? window.dechirp.frames : 0")

    @property
    def frame_label(self) -> str:
        return self.page.locator("#place").text_content()

    @property
    def median_db(self) -> float:
        return self.page.evaluate(_MEDIAN_DB_JS)

    @property
    def focused_name(self) -> str:
        return self.page.evaluate(_FOCUSED_NAME_JS)

    @property
    def settings(self) -> Scenario:
        """Current settings, from the text that can be copied and downloaded."""
        call = """() => [...Bokeh.documents[0].get_model_by_name("settings_file").references()]
          .find((model) => model.type === "TextAreaInput").tags[0]"""
        return parse_settings(self.page.evaluate(call), Scenario)

    def act_and_wait_for_frame(self, act: Callable[[], object]) -> None:
        """Perform an action, and wait until the next frame is drawn."""
        n_before = self.n_frames
        act()
        self.wait_until(lambda: self.n_frames > n_before)

    def press_button(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).locator("visible=true").click()

    def open_tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def locate_knob(self, path: str):
        """Locate the input of a setting on the open tab, below headings that are opened."""
        for heading in self.page.locator("[role=tabpanel] .fold button:visible").all():
            if heading.text_content().startswith("▸"):
                heading.click()
                self.wait_until(lambda it=heading: it.text_content().startswith("▾"))
        return self.page.locator(f'[data-setting="{path}"] :is(input, select):visible')

    def type_setting(self, path: str, text: str) -> None:
        self.locate_knob(path).fill(text)
        self.locate_knob(path).press("Enter")

    def read_tile_title(self, name: str) -> str:
        return self.page.locator(f"#title-{name}").text_content()

    def read_text(self, selector: str) -> str:
        return self.page.evaluate(_TEXT_JS, selector)

    def read_figure_data(self, name: str) -> str:
        """Read the data of all figures below a root."""
        return self.page.evaluate(_SOURCE_COLUMNS_JS, name)

    def screen_position(self, name: str, x: float, y: float) -> tuple[float, float]:
        return tuple(self.page.evaluate(_SCREEN_POSITION_JS, [name, x, y]))

    @property
    def pointer_in_scene(self) -> str:
        """Shape of the pointer in the top view."""
        call = "() => findView('scene').canvas_view.events_el.style.cursor"
        return self.page.evaluate(call)

    def download_settings(self, file: Path) -> Scenario:
        """Download the settings and load them like the command line."""
        self.open_tab("File")
        with self.page.expect_download() as download_event:
            self.press_button("Download")
        download_event.value.save_as(file)
        return load(file)

    @property
    def rule_colours(self) -> list[str]:
        """Colours of the lines round a map and of those on the page."""
        call = """() => {
          const of = Bokeh.documents[0].get_model_by_name("range_doppler").outline_line_color;
          const page = getComputedStyle(document.documentElement).getPropertyValue("--rule");
          return [of?.value ?? of, page.trim()];
        }"""
        return self.page.evaluate(call)

    def save_screenshot(self, name: str) -> None:
        """Save a screenshot if DECHIRP_SCREENSHOTS names a folder."""
        if SCREENSHOT_FOLDER:
            Path(SCREENSHOT_FOLDER).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=Path(SCREENSHOT_FOLDER) / f"{name}.png")


@contextmanager
def new_live_page(browser, address: str, width: int, height: int) -> Iterator[LivePage]:
    """Create a page that is not opened yet, and check its requests and errors at the end."""
    # With reduced motion the page does not begin to play.
    context = browser.new_context(
        viewport={"width": width, "height": height}, reduced_motion="reduce"
    )
    page = LivePage(context, address)
    yield page
    context.close()
    assert page.external_urls == []
    assert page.errors == []


@pytest.fixture(params=["1280x720"])
def live_page(request, browser, address) -> Iterator[LivePage]:
    width, height = re.findall(r"\d+", request.param)
    with new_live_page(browser, address, int(width), int(height)) as page:
        yield page


@pytest.fixture(scope="module")
def shared_page(browser, address) -> Iterator[LivePage]:
    """Open the live page once for tests that do not depend on what earlier ones changed."""
    with new_live_page(browser, address, 1280, 720) as page:
        yield page.open()
