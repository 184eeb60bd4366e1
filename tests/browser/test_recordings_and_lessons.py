"""Recordings, two settings beside each other, and the lessons, in a browser."""

import re

import pytest


def test_a_recording_is_looked_over_opened_and_walked_through(looked):
    looked.go()
    looked.tab("Recordings")
    panel = looked.page.locator("#page-recordings")
    file = panel.get_by_label("Recording or scenario")
    looked.until(lambda: file.locator("option").count() > 1)
    file.select_option(label=file.locator("option", has_text="street.npz").text_content())
    panel.get_by_text(re.compile("Found in .* frames|No faults were found")).first.wait_for()
    looked.drawn_after(lambda: looked.press("Open"))
    looked.until(lambda: "target" not in looked.title("scene"))
    seen = {looked.data("range_doppler")}
    for step in range(1, 6):
        looked.drawn_after(lambda: looked.press("Step"))
        assert looked.place.startswith(f"frame {step},")
        seen.add(looked.data("range_doppler"))
    assert len(seen) == 6
    panel.get_by_text("Frame, of 6").wait_for()
    looked.tab("Findings")
    looked.page.locator("#page-findings").get_by_text(re.compile(r"\w+")).first.wait_for()
    looked.shot("recording")
    looked.drawn_after(lambda: looked.press("Back to the scene"))
    looked.until(lambda: "5 targets" in looked.title("scene"))


def test_two_settings_are_counted_against_each_other(looked):
    looked.go()
    looked.tab("Compare A/B")
    looked.press("Keep as A")
    looked.drawn_after(lambda: looked.type("radar.hardware.noise_factor", "42 dB"))
    looked.press("Keep as B")
    table = looked.page.locator("#page-compare table")
    counted = looked.page.locator("#page-compare").get_by_text("trials each")
    counted.wait_for()
    looked.until(lambda: int(counted.inner_text().split(" trials")[0].replace(",", "")) >= 10)
    # 30 dB more noise hides a target that 37 dB in the map showed in every frame.
    table.get_by_text("A better").first.wait_for()
    assert "noise_factor" in counted.inner_text()
    looked.shot("compare")


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_lesson_plays_and_what_it_asks_to_try_changes_its_figure(looked, number):
    looked.go(f"teach/{number}")
    before = looked.data("figures")
    looked.shot(f"lesson-{number}")
    play = looked.page.get_by_role("button", name=re.compile("Play$"))
    play.click()
    looked.until(lambda: looked.frames > 4)
    assert looked.data("figures") != before
    looked.page.get_by_role("button", name=re.compile("Pause$")).click()
    play.wait_for()
    before = looked.data("figures")
    answer = looked.text("#answer")
    looked.page.locator("#tries").get_by_role("button").last.click()
    looked.until(lambda: looked.text("#answer") != answer)
    looked.until(lambda: looked.data("figures") != before)
    looked.shot(f"lesson-{number}-tried")
