"""Sliders, undo, settings in the address, folds and playback at start, in a browser."""

import pytest

from conftest import LivePage
from nightly import nightly

SET_SLIDER_JS = """([title, value]) => {
  const models = Bokeh.documents[0].get_model_by_name("main_settings").references();
  [...models].find((model) => model.title?.startsWith(title)).value = value;
}"""


def move_slider(live_page, title: str, value: float) -> None:
    live_page.page.evaluate(SET_SLIDER_JS, [title, value])


@nightly
def test_slider_changes_radar_until_undo_and_address_carries_settings(live_page):
    live_page.open()
    page, before = live_page.page, live_page.settings
    handle = page.get_by_role("slider", name="Noise figure (dB)")
    handle.focus()
    live_page.act_and_wait_for_frame(lambda: handle.press("ArrowRight"))
    live_page.wait_until(
        lambda: live_page.settings.radar.hardware.noise_factor == pytest.approx(10**1.3)
    )
    live_page.act_and_wait_for_frame(lambda: move_slider(live_page, "Bandwidth", 600))
    live_page.wait_until(
        lambda: live_page.settings.radar.frame.chirp.sampled_bandwidth_hz == pytest.approx(600e6)
    )
    changed = live_page.settings
    live_page.wait_until(lambda: "#" in page.url)

    other_page = LivePage(live_page.context, page.url).open()
    other_page.wait_until(lambda: other_page.settings == changed)
    other_page.page.close()

    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Undo"))
    live_page.act_and_wait_for_frame(lambda: page.keyboard.press("Control+z"))
    live_page.wait_until(lambda: live_page.settings == before)
    live_page.wait_until(lambda: "#" not in page.url)
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Redo"))


@nightly
def test_damaged_address_is_reported(live_page):
    live_page.open("#not-settings")
    live_page.page.locator("[data-part=trouble]").get_by_text("expected").wait_for()


@nightly
def test_lists_are_folded(live_page):
    live_page.open()
    live_page.open_tab("Scene")
    fields = live_page.page.locator("#page-targets :is(input, select):visible")
    assert fields.count() < 8
    live_page.open_tab("Radar")
    assert live_page.page.locator("#page-radar input[type=checkbox]:visible").count() == 0
    live_page.locate_knob("impairments.phase-noise").wait_for()
    live_page.save_screenshot("unfolded")


@nightly
def test_page_begins_to_play(browser, address):
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    live_page = LivePage(context, address).open()
    live_page.wait_until(lambda: live_page.n_frames > 3)
    live_page.press_button("Pause")
    context.close()
    assert live_page.errors == []
