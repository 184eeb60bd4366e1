"""Layout of the live page on narrow and wide screens, text size, touch and accessibility."""

from io import BytesIO
from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.image import imread

from conftest import LivePage, is_apart
from nightly import nightly

TILES = ("scene", "range_doppler", "range_azimuth", "beat", "cut", "micro_doppler")
# 640 x 360 is a screen of 1280 x 720 at 200 % zoom.
SIZES = ((500, 900), (640, 360), (800, 1000), (1280, 720), (1920, 1080))
COLUMN_WIDTH = 1100

# Sizes of the visible text in pixels, with the text: of HTML, and of all figures.
TEXT_SIZES_JS = """() => {
  const sizes = [];
  const visit = (node) => {
    for (const child of node.childNodes) {
      if (child.nodeType === Node.TEXT_NODE && child.data.trim()) {
        const element = child.parentElement ?? child.getRootNode().host;
        if (!/STYLE|SCRIPT/.test(element.tagName) && element.getClientRects().length)
          sizes.push([parseFloat(getComputedStyle(element).fontSize), child.data.trim()]);
      }
      if (child.shadowRoot) visit(child.shadowRoot);
      visit(child);
    }
  };
  visit(document.body);
  for (const model of Bokeh.documents[0]._all_models.values())
    for (const property of model)
      if (/font_size$/.test(property.attr) && ["LinearAxis", "ColorBar", "Title", "Legend"]
          .includes(model.type)) {
        const size = property.get_value();
        sizes.push([parseFloat(size?.value ?? size), `${model.type}.${property.attr}`]);
      }
  return sizes;
}"""
SHOW_ALL_TABS_JS = """() => {
  for (const page of document.querySelectorAll("[role=tabpanel]")) page.hidden = false;
}"""
OVERFLOWING_TITLES_JS = """() => {
  const titles = [...document.querySelectorAll("h2, figcaption p")];
  const visit = (node) => {
    titles.push(...node.querySelectorAll("th, td"));
    for (const child of node.querySelectorAll("*")) if (child.shadowRoot) visit(child.shadowRoot);
  };
  visit(document);
  return titles.filter((one) => one.offsetWidth
      && (one.scrollWidth > one.clientWidth + 1 || one.scrollHeight > one.clientHeight + 1
        || !one.matches("td") && one.offsetHeight > one.parentElement.clientHeight))
    .map((one) => one.textContent);
}"""
TITLE_HEIGHTS_JS = """() => {
  const heights = [];
  const visit = (node) => {
    for (const title of node.querySelectorAll("thead th"))
      heights.push(title.offsetHeight);
    for (const child of node.querySelectorAll("*")) if (child.shadowRoot) visit(child.shadowRoot);
  };
  visit(document);
  return heights;
}"""


@nightly
def test_page_is_legible_at_every_width(shared_page):
    page = shared_page.page
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(400)
        size = page.evaluate(
            "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
        )
        assert size[0] == width, width
        for tab in ("Tracks", "Detections"):
            shared_page.open_tab(tab)
            page.wait_for_timeout(100)
            assert page.evaluate(OVERFLOWING_TITLES_JS) == [], width
        if width >= 1280:  # titles of detections need one line, and leave the others to rows
            assert 10 < max(page.evaluate(TITLE_HEIGHTS_JS)) < 30
        boxes = [page.locator(f"[data-part={name}]").bounding_box() for name in TILES]
        is_column = width < COLUMN_WIDTH
        assert page.locator("#side").is_visible() != is_column
        if is_column:
            assert size[1] > height  # the page scrolls
            assert {box["x"] for box in boxes} == {6} and boxes[0]["width"] == width - 12
            boxes.append(page.locator("#strip").bounding_box())
            for upper, lower in pairwise(boxes):
                assert 0 < lower["y"] - upper["y"] - upper["height"] < 10
        else:
            assert size[1] == height
            assert len({box["x"] for box in boxes}) == 3
            assert all(is_apart(*pair) for pair in combinations(boxes, 2))
        assert min(box["height"] for box in boxes) > 200
        shared_page.save_screenshot(f"width-{width}")
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    shared_page.press_button("Settings")
    assert page.locator("#side").is_visible()
    assert page.locator("#fold").get_attribute("aria-expanded") == "true"
    for width, height in SIZES[:3]:
        page.set_viewport_size({"width": width, "height": height})
        panel = page.locator("#side [role=tabpanel]:visible").bounding_box()
        assert panel["height"] > 200 and panel["width"] > width - 50  # as its sliders need
    small = [entry for entry in page.evaluate(TEXT_SIZES_JS) if entry[0] < 12]
    assert small == []


@nightly
def test_error_note_covers_no_title(shared_page):
    page = shared_page.page
    page.set_viewport_size({"width": 1280, "height": 720})
    shared_page.open_tab("Radar")
    shared_page.type_setting("radar.frame.interval", "2 us")
    note = page.locator("[data-part=trouble]").get_by_text("ramp").first
    note.wait_for()
    page.wait_for_timeout(400)
    box = page.locator("[data-part=trouble]").bounding_box()
    assert box["height"] > 20
    assert all(is_apart(box, tile.bounding_box()) for tile in page.locator(".tile").all())
    page.set_viewport_size({"width": 500, "height": 900})
    box = page.locator("[data-part=trouble]").bounding_box()
    assert box["y"] > 450 and box["y"] + box["height"] <= 900  # in sight, at the lower edge
    page.set_viewport_size({"width": 1280, "height": 720})
    shared_page.act_and_wait_for_frame(
        lambda: shared_page.type_setting("radar.frame.interval", "35 us")
    )


@nightly
def test_figures_keep_their_size_from_frame_to_frame(live_page):
    live_page.open()
    plots = live_page.page.locator(".tile .plot")
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    heights = [plot.bounding_box()["height"] for plot in plots.all()]
    assert min(heights) > 130
    for _ in range(5):
        live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    later = [plot.bounding_box()["height"] for plot in plots.all()]
    # A caption may grow by a line, once.
    assert all(old - 20 < new <= old for old, new in zip(heights, later, strict=True))


@nightly
def test_finger_moves_cursor(browser, address):
    context = browser.new_context(
        viewport={"width": 500, "height": 900}, has_touch=True, reduced_motion="reduce"
    )
    live_page = LivePage(context, address).open()
    live_page.page.locator("[data-part=range_doppler]").scroll_into_view_if_needed()
    position = live_page.screen_position("range_doppler", 60.0, 5.0)
    live_page.act_and_wait_for_frame(lambda: live_page.page.touchscreen.tap(*position))
    live_page.wait_until(lambda: "at 60" in live_page.read_text("[data-part=cut] figcaption"))
    context.close()
    assert live_page.errors == []


@nightly
def test_tile_is_enlarged_saved_as_picture_and_read_at_pointer(live_page, tmp_path):
    live_page.open()
    page = live_page.page
    tile = page.locator("[data-part=range_doppler]")
    car = next(t for t in live_page.settings.scene.targets if t.name == "post")
    range_m = sum(x**2 for x in car.position_m) ** 0.5
    page.mouse.move(*live_page.screen_position("range_doppler", range_m, 0.0))
    text = tile.locator(".readout").text_content()
    assert text.startswith("Range 4") and "Velocity" in text and text.endswith(" dBm"), text
    level_db = float(text.split()[-2].replace("\N{MINUS SIGN}", "-"))
    assert level_db > live_page.median_db + 20  # the echo, not the noise
    with page.expect_download() as download_event:
        tile.get_by_role("button", name="Save a picture").click()
    picture = tmp_path / "map.png"
    download_event.value.save_as(picture)
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000
    small = tile.bounding_box()
    tile.get_by_role("button", name="Enlarge").click()
    assert tile.bounding_box()["width"] > 2.5 * small["width"]
    live_page.save_screenshot("enlarged")
    page.keyboard.press("Escape")
    assert tile.bounding_box() == small


@nightly
def test_marks_leave_echoes_visible_and_can_be_hidden(live_page):
    live_page.open()
    tile = live_page.page.locator("[data-part=range_doppler]")
    assert "[ ] detected" in live_page.read_text("[data-part=range_doppler] figcaption")
    positions = live_page.page.evaluate(_MARK_POSITIONS_JS)
    marked_echoes = [_read_echo_colours(live_page, *position) for position in positions]
    tile.get_by_role("button", name="Marks").click()
    live_page.wait_until(
        lambda: "detected" not in live_page.read_text("[data-part=range_doppler] figcaption p")
    )
    live_page.page.wait_for_timeout(500)  # the marks are gone
    assert len(positions) >= 4
    echoes = [_read_echo_colours(live_page, *position) for position in positions]
    # No bracket reaches these pixels; a line across would change them by 0.5 and more.
    np.testing.assert_allclose(marked_echoes, echoes, atol=0.005)


_MARK_POSITIONS_JS = """() => {
  const figure = Bokeh.documents[0].get_model_by_name("range_doppler");
  const marks = figure.renderers.find((renderer) => renderer.glyph.type === "Rect");
  const { x, y } = marks.data_source.data;
  return [...x].map((position, i) => [position, y[i]]);
}"""


def _read_echo_colours(live_page, x: float, y: float) -> np.ndarray:
    """Read the 4 x 4 pixels around a place of the range-Doppler map."""
    left, top = live_page.screen_position("range_doppler", x, y)
    box = {"x": left - 2, "y": top - 2, "width": 4, "height": 4}
    return imread(BytesIO(live_page.page.screenshot(clip=box)))


@nightly
def test_axe_finds_nothing_critical_or_serious(shared_page):
    shared_page.page.set_viewport_size({"width": 1280, "height": 720})
    check_accessibility(shared_page)


@nightly
@pytest.mark.parametrize(
    ("path", "shade"),
    [
        ("", "dark"),
        ("teach/1", "dark"),
        ("teach/2", "light"),
        ("teach/3", "dark"),
        ("teach/4", "light"),
    ],
)
def test_axe_finds_nothing_in_lessons_and_dark_theme(live_page, shade, path):
    live_page.page.emulate_media(color_scheme=shade)
    live_page.open(path)
    check_accessibility(live_page)


def check_accessibility(live_page: LivePage) -> None:
    """Check that axe finds nothing critical or serious, on hidden tabs too."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    live_page.page.evaluate(SHOW_ALL_TABS_JS)
    violations = axe.run(live_page.page).response["violations"]
    assert [
        (violation["id"], [node["target"] for node in violation["nodes"]])
        for violation in violations
        if violation["impact"] in ("critical", "serious")
    ] == []
    # Text that changes five times a second is not read out.
    assert live_page.page.locator("output:not([aria-live=off])").count() == 0
