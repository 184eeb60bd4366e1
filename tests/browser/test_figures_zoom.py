"""A report from disk, in a browser that reaches nothing: its figures open large, and close."""

import pytest

import dechirp as dc
from dechirp.experiments.run import run
from dechirp.report.page import render_report
from trial_cases import make_target, small_radar

CLOSED, OPEN = "document.querySelector('dialog').open", "dialog[open] svg"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    scenario = dc.Scenario(radar=small_radar(), scene=dc.Scene(targets=(make_target(name="car"),)))
    made = tmp_path_factory.mktemp("report") / "report.html"
    made.write_text(render_report(run(scenario), yaml="name: car"), encoding="utf-8")
    return made


def box(page) -> list[float]:
    """What the large figure shows of the whole: x, y, width, height."""
    return [float(one) for one in page.locator(OPEN).get_attribute("viewBox").split()]


@pytest.fixture
def page(browser, file):
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page, wrong, asked = context.new_page(), [], []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    context.set_offline(True)
    page.goto(file.as_uri())
    yield page
    context.close()
    assert wrong == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


def test_a_click_opens_a_figure_that_zooms_and_pans_and_escape_closes_it(page):
    page.locator("figure > svg").first.click()
    whole = box(page)
    caption = page.locator("figcaption").first.inner_text()
    assert page.locator("dialog p").inner_text() == caption

    middle = page.locator(OPEN).bounding_box()
    at = (middle["x"] + middle["width"] / 2, middle["y"] + middle["height"] / 2)
    page.mouse.move(*at)
    page.mouse.wheel(0, -400)
    page.wait_for_function(f"document.querySelector('{OPEN}').viewBox.baseVal.width < {whole[2]}")
    near = box(page)
    # The middle of the figure stays under the pointer.
    assert near[0] + near[2] / 2 == pytest.approx(whole[2] / 2, abs=0.01 * whole[2])

    page.mouse.down()
    page.mouse.move(at[0] - 100, at[1])
    page.mouse.up()
    assert box(page)[0] > near[0]
    page.get_by_role("button", name="Whole figure").click()
    assert box(page) == whole
    page.keyboard.press("Escape")
    assert not page.evaluate(CLOSED)


def test_the_keyboard_alone_opens_zooms_and_closes(page):
    page.get_by_role("button", name="Enlarge").first.focus()
    page.keyboard.press("Enter")
    whole = box(page)
    page.keyboard.press("+")
    page.keyboard.press("ArrowRight")
    x, _, width, _ = box(page)
    assert width < whole[2]
    assert x + width / 2 > whole[2] / 2
    page.keyboard.press("-")
    assert box(page) == whole
    page.keyboard.press("Escape")
    assert not page.evaluate(CLOSED)


def test_without_scripts_the_page_is_whole(browser, file):
    context = browser.new_context(java_script_enabled=False, offline=True)
    page = context.new_page()
    page.goto(file.as_uri())

    assert page.locator("figure > svg").count() == page.locator("figcaption").count() > 3
    assert page.get_by_role("button").count() == 0
    context.close()


def test_on_paper_there_are_no_controls_and_no_table_is_cut_off(page):
    page.emulate_media(media="print")

    assert page.get_by_role("button").count() == 0
    assert page.locator("pre").last.is_visible()
    hidden = """() => [...document.querySelectorAll(".scroll")].filter(
      (one) => one.scrollHeight > one.clientHeight + 1).length"""
    assert page.evaluate(hidden) == 0
