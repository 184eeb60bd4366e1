"""Figures of a report in an offline browser: enlarging, zooming and printing."""

import pytest

import dechirp as dc
from dechirp.experiments.run import run
from dechirp.report.page import render_report
from nightly import nightly
from trial_cases import make_target, small_radar

DIALOG_IS_OPEN_JS, OPEN_FIGURE = "document.querySelector('dialog').open", "dialog[open] svg"


@pytest.fixture(scope="module")
def report_file(tmp_path_factory):
    scenario = dc.Scenario(radar=small_radar(), scene=dc.Scene(targets=(make_target(name="car"),)))
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_report(run(scenario), yaml="name: car"), encoding="utf-8")
    return path


def read_view_box(page) -> list[float]:
    """Return the view box of the enlarged figure: x, y, width, height."""
    return [float(value) for value in page.locator(OPEN_FIGURE).get_attribute("viewBox").split()]


@pytest.fixture
def page(browser, report_file):
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page, errors, requested_urls = context.new_page(), [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: requested_urls.append(request.url))
    context.set_offline(True)
    page.goto(report_file.as_uri())
    yield page
    context.close()
    assert errors == []
    assert [url for url in requested_urls if not url.startswith(("file:", "data:"))] == []


@nightly
def test_click_opens_figure_that_zooms_pans_and_closes_with_escape(page):
    page.locator("figure > svg").first.click()
    full_box = read_view_box(page)
    caption = page.locator("figcaption").first.inner_text()
    assert page.locator("dialog p").inner_text() == caption

    bounds = page.locator(OPEN_FIGURE).bounding_box()
    centre = (bounds["x"] + bounds["width"] / 2, bounds["y"] + bounds["height"] / 2)
    page.mouse.move(*centre)
    page.mouse.wheel(0, -400)
    page.wait_for_function(
        f"document.querySelector('{OPEN_FIGURE}').viewBox.baseVal.width < {full_box[2]}"
    )
    zoomed_box = read_view_box(page)
    # The centre of the figure stays under the pointer.
    assert zoomed_box[0] + zoomed_box[2] / 2 == pytest.approx(
        full_box[2] / 2, abs=0.01 * full_box[2]
    )

    page.mouse.down()
    page.mouse.move(centre[0] - 100, centre[1])
    page.mouse.up()
    assert read_view_box(page)[0] > zoomed_box[0]
    page.get_by_role("button", name="Whole figure").click()
    assert read_view_box(page) == full_box
    page.keyboard.press("Escape")
    assert not page.evaluate(DIALOG_IS_OPEN_JS)


@nightly
def test_keyboard_opens_zooms_and_closes_figure(page):
    page.get_by_role("button", name="Enlarge").first.focus()
    page.keyboard.press("Enter")
    full_box = read_view_box(page)
    page.keyboard.press("+")
    page.keyboard.press("ArrowRight")
    x, _, width, _ = read_view_box(page)
    assert width < full_box[2]
    assert x + width / 2 > full_box[2] / 2
    page.keyboard.press("-")
    assert read_view_box(page) == full_box
    page.keyboard.press("Escape")
    assert not page.evaluate(DIALOG_IS_OPEN_JS)


@nightly
def test_report_without_scripts_shows_all_figures(browser, report_file):
    context = browser.new_context(java_script_enabled=False, offline=True)
    page = context.new_page()
    page.goto(report_file.as_uri())

    assert page.locator("figure > svg").count() == page.locator("figcaption").count() > 3
    assert page.get_by_role("button").count() == 0
    context.close()


@nightly
def test_printed_report_has_no_controls_and_no_truncated_table(page):
    page.emulate_media(media="print")

    assert page.get_by_role("button").count() == 0
    assert page.locator("pre").last.is_visible()
    hidden = """() => [...document.querySelectorAll(".scroll")].filter(
      (one) => one.scrollHeight > one.clientHeight + 1).length"""
    assert page.evaluate(hidden) == 0
