"""Recordings, A/B comparison and lessons in a browser."""

import re

import pytest

from nightly import nightly


@nightly
def test_recording_is_inspected_opened_and_played(live_page):
    live_page.open()
    live_page.open_tab("Recordings")
    panel = live_page.page.locator("#page-recordings")
    file = panel.get_by_label("Recording or scenario")
    live_page.wait_until(lambda: file.locator("option").count() > 1)
    file.select_option(label=file.locator("option", has_text="street.npz").text_content())
    panel.get_by_text(re.compile("Found in .* frames|No faults were found")).first.wait_for()
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Open"))
    live_page.wait_until(lambda: "target" not in live_page.read_tile_title("scene"))
    map_contents = {live_page.read_figure_data("range_doppler")}
    for step in range(1, 6):
        live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
        assert live_page.frame_label.startswith(f"frame {step},")
        map_contents.add(live_page.read_figure_data("range_doppler"))
    assert len(map_contents) == 6
    panel.get_by_text("Frame, of 6").wait_for()
    live_page.open_tab("Findings")
    live_page.page.locator("#page-findings").get_by_text(re.compile(r"\w+")).first.wait_for()
    live_page.save_screenshot("recording")
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Back to the scene"))
    live_page.wait_until(lambda: "5 targets" in live_page.read_tile_title("scene"))


@nightly
def test_two_settings_are_compared_by_trials(live_page):
    live_page.open()
    live_page.open_tab("Compare A/B")
    live_page.press_button("Keep as A")
    live_page.open_tab("Scene")
    live_page.act_and_wait_for_frame(
        lambda: live_page.type_setting("radar.hardware.noise_factor", "42 dB")
    )
    live_page.press_button("Keep as B")
    table = live_page.page.locator("#page-compare table")
    trial_count = live_page.page.locator("#page-compare").get_by_text("trials each")
    trial_count.wait_for()
    live_page.wait_until(
        lambda: int(trial_count.inner_text().split(" trials")[0].replace(",", "")) >= 10
    )
    # 30 dB more noise hides a target that is 37 dB above noise in the map.
    table.get_by_text("A better").first.wait_for()
    assert "noise_factor" in trial_count.inner_text()
    live_page.save_screenshot("compare")
    live_page.page.set_viewport_size({"width": 500, "height": 900})
    live_page.wait_until(lambda: not table.locator("thead").is_visible())
    rights_and_heights = table.evaluate(
        "table => [...table.querySelectorAll('td')].map(cell => cell.getBoundingClientRect())"
        ".map(box => [box.right, box.height])"
    )
    assert max(right for right, _ in rights_and_heights) <= 500
    assert max(height for _, height in rights_and_heights) < 100  # no word is broken into letters
    table.evaluate("table => table.scrollIntoView()")  # trials replace it meanwhile
    live_page.save_screenshot("compare-500")


@nightly
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_lesson_plays_and_experiment_changes_its_figure(live_page, number):
    live_page.open(f"teach/{number}")
    figure_data = live_page.read_figure_data("figures")
    live_page.save_screenshot(f"lesson-{number}")
    play = live_page.page.get_by_role("button", name=re.compile("Play$"))
    play.click()
    # A lesson that waits for confirmations plays 1 frame a second, on the busiest cores also.
    live_page.wait_until(lambda: _count_frames_in_4_s(live_page) > 12)
    assert live_page.read_figure_data("figures") != figure_data
    live_page.page.get_by_role("button", name=re.compile("Pause$")).click()
    play.wait_for()
    figure_data = live_page.read_figure_data("figures")
    answer = live_page.read_text("#answer")
    live_page.page.locator("#tries").get_by_role("button").last.click()
    live_page.wait_until(lambda: live_page.read_text("#answer") != answer)
    live_page.wait_until(lambda: live_page.read_figure_data("figures") != figure_data)
    live_page.save_screenshot(f"lesson-{number}-tried")


def _count_frames_in_4_s(live_page) -> int:
    n_frames = live_page.n_frames
    live_page.page.wait_for_timeout(4000)
    return live_page.n_frames - n_frames
