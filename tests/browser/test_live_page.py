"""The live page in a browser: what a user does with it, and what is then seen."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread

from dechirp.processing.cfar.cell_averaging import SmallestOf

TILES = ("scene", "range_doppler", "range_azimuth", "beat", "cut", "micro_doppler")


@pytest.mark.parametrize("looked", ["1280x720", "1920x1080"], indirect=True)
@pytest.mark.parametrize("shade", ["light", "dark"])
def test_it_loads_whole_and_nothing_overlaps_or_is_cut_off(looked, shade):
    looked.page.emulate_media(color_scheme=shade)
    looked.go()
    size = looked.page.viewport_size
    boxes = {name: looked.page.locator(f"[data-part={name}]").bounding_box() for name in TILES}
    for name, box in boxes.items():
        assert box["width"] > 250 and box["height"] > 200, name
        assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"], name
        assert box["y"] >= 0 and box["y"] + box["height"] <= size["height"], name
        for other, its in boxes.items():
            apart = (
                box["x"] + box["width"] <= its["x"]
                or its["x"] + its["width"] <= box["x"]
                or box["y"] + box["height"] <= its["y"]
                or its["y"] + its["height"] <= box["y"]
            )
            assert name == other or apart, (name, other)
    page = looked.page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    )
    assert page == [size["width"], size["height"]]
    assert looked.page.evaluate("document.documentElement.dataset.shade") == shade
    looked.until(lambda: len(set(looked.grounds)) == 1)
    looked.drawn_after(lambda: looked.press("Step"))
    looked.shot(f"live-{shade}-{size['width']}")


def test_it_plays_pauses_steps_and_rewinds_to_the_same_frame(looked):
    looked.go()
    first = looked.data("beat")
    looked.press("Play")
    looked.until(lambda: looked.frames > 4)
    looked.shot("playing")
    looked.press("Pause")
    looked.page.get_by_role("button", name="Play", exact=True).wait_for()
    paused = looked.place
    looked.press("Step")
    looked.until(lambda: looked.place != paused)
    assert looked.data("beat") != first
    looked.press("Rewind")
    looked.until(lambda: looked.place.startswith("frame 0,"))
    looked.until(lambda: looked.data("beat") == first)


def test_a_target_is_dragged_to_another_place(looked, tmp_path):
    looked.go()
    car = _target(looked.settings, "car")
    x, y, z = car.position_m
    mouse = looked.page.mouse
    start, end = looked.on_screen("scene", y, x), looked.on_screen("scene", y + 6, x + 8)
    mouse.move(*start)
    mouse.down()
    for part in range(1, 6):
        mouse.move(*(a + (b - a) * part / 5 for a, b in zip(start, end, strict=True)))
    mouse.up()
    # A pixel of the view from above is half a metre.
    there = pytest.approx((x + 8, y + 6, z), abs=0.5)
    looked.until(lambda: _target(looked.settings, "car").position_m == there)
    after = _target(looked.download(tmp_path / "after.yaml"), "car")
    assert after.position_m == there
    assert after.velocity_m_per_s == car.velocity_m_per_s
    looked.shot("dragged")


def test_noise_that_is_typed_six_decibels_higher_lifts_the_map_by_six(looked):
    looked.go()
    before_db = looked.median_db
    looked.drawn_after(lambda: looked.type("radar.hardware.noise_factor", "18 dB"))
    # The same noise, larger; each level stands for up to 60 dB / 255.
    assert looked.median_db - before_db == pytest.approx(6, abs=0.5)
    looked.shot("more-noise")


def test_another_detector_has_another_threshold_and_stands_in_the_file(looked, tmp_path):
    looked.go()
    looked.tab("Processing")
    before = looked.text("[data-part=cut]")
    assert "over the threshold" in before
    choose = looked.knob("chain.cfar.estimator")
    looked.drawn_after(lambda: choose.select_option("smallest-of"))
    assert "over the threshold" in looked.text("[data-part=cut]") != before
    looked.until(lambda: isinstance(looked.settings.chain.cfar.estimator, SmallestOf))
    saved = looked.download(tmp_path / "after.yaml")
    assert isinstance(saved.chain.cfar.estimator, SmallestOf)


@pytest.mark.parametrize(
    ("path", "text", "words"),
    [
        ("radar.hardware.noise_factor", "loud", "loud; expected a ratio, as 4 or 6 dB"),
        ("scene.targets.car.position", "[48, -3.5, 0]", "48; expected a length, as 50 m"),
        ("scene.targets.car.rcs", "__import__('os').getpid()", "but must be a radar cross section"),
    ],
)
def test_a_wrong_value_is_answered_beside_it_and_the_page_lives_on(looked, path, text, words):
    looked.go()
    held = looked.settings
    looked.type(path, text)
    note = looked.page.locator("[data-part=trouble]")
    note.get_by_text("; expected ").wait_for()
    said = looked.text("[data-part=trouble]")
    assert path in said and words in said, said
    looked.page.locator("#page-targets .wrong").filter(has_text="expected").first.wait_for()
    looked.shot("wrong")
    looked.knob(path).press("Escape")
    looked.drawn_after(lambda: looked.press("Step"))
    assert looked.settings == held
    assert not note.get_by_text("; expected ").is_visible()


def test_a_file_outside_of_the_folders_is_refused(looked):
    looked.go()
    looked.tab("File")
    area = looked.page.locator("#page-settings_file textarea")
    area.fill("recording: {path: ../../etc/passwd}\n")
    area.blur()
    looked.press("Apply")
    note = looked.page.locator("[data-part=trouble]")
    note.get_by_text("a file in the folders of the studio").wait_for()
    assert "root:" not in looked.page.content()
    looked.drawn_after(lambda: looked.press("Step"))


def test_a_radar_is_designed_from_what_it_should_do_and_taken(looked):
    looked.go()
    looked.tab("Design")
    answer = looked.page.locator("#page-requirements")
    looked.type("range_resolution", "0.5 m")
    looked.type("max_range", "60 m")
    looked.type("max_velocity", "20 m/s")
    answer.get_by_role("heading", name="Met", exact=True).wait_for()
    looked.page.get_by_role("button", name="Use this radar").hover()
    looked.shot("design")
    looked.drawn_after(lambda: looked.press("Use this radar"))
    looked.until(
        lambda: looked.settings.radar.frame.chirp.range_resolution_m == pytest.approx(0.5, rel=0.01)
    )
    assert looked.settings.radar.frame.max_velocity_m_per_s >= 20


def test_the_keyboard_alone_plays_changes_a_setting_and_opens_a_tab(looked):
    looked.go()
    keys = looked.page.keyboard
    _tab_to(looked, "Play")
    keys.press("Space")
    looked.until(lambda: looked.frames > 3)
    keys.press("Space")
    _tab_to(looked, "Scene")
    keys.press("ArrowRight")
    assert looked.focused == "Radar"
    _tab_to(looked, "radar.frame.chirp.slope")
    looked.drawn_after(
        lambda: looked.page.evaluate(
            "Bokeh.documents[0].get_model_by_name('browser').step_keys += 1"
        )
    )
    assert looked.focused == "radar.frame.chirp.slope"  # no table takes it away
    keys.press("Control+A")
    keys.type("20 MHz/us")
    keys.press("Enter")
    looked.until(lambda: looked.settings.radar.frame.chirp.slope_hz_per_s == pytest.approx(20e12))


def test_the_other_pages_live_when_one_is_closed_while_it_plays(looked):
    looked.go()
    other = looked.context.new_page()
    other.goto(looked.address)
    frames = "() => window.dechirp?.ready ? window.dechirp.frames : 0"
    looked.until(lambda: other.evaluate(frames) > 0)
    other.get_by_role("button", name="Play", exact=True).click()
    looked.until(lambda: other.evaluate(frames) > 3)
    other.close()
    for _ in range(3):
        looked.drawn_after(lambda: looked.press("Step"))
    assert looked.place.startswith("frame 3,")


def _target(scenario, name: str):
    return next(one for one in scenario.scene.targets if one.name == name)


def _tab_to(looked, name: str) -> None:
    """Go on with the tabulator until something has the focus."""
    for _ in range(60):
        looked.page.keyboard.press("Tab")
        if looked.focused == name:
            return
    raise AssertionError(f"{name} is not reached")


_RANGES = """(name) => [...[...Bokeh.documents[0].get_model_by_name(name).references()]
  .find((model) => model.type === "DataTable").source.data.range]"""


def test_rows_change_with_the_frame_also_when_there_are_as_many_and_behind_another_tab(looked):
    looked.go()

    def is_told() -> bool:
        shown = looked.text("[data-part=detections]")
        ranges_m = looked.page.evaluate(_RANGES, "detections")
        in_sight = ranges_m[:4]  # others are drawn when they are scrolled to
        return len(in_sight) > 0 and all(f"{one:.3f}" in shown for one in in_sight)

    seen = set()
    for _ in range(4):
        looked.drawn_after(lambda: looked.press("Step"))
        looked.until(is_told)
        seen.add(tuple(looked.page.evaluate(_RANGES, "detections")))
    assert len(seen) == 4 and len({len(one) for one in seen}) < 4
    looked.tab("Findings")
    looked.drawn_after(lambda: looked.press("Step"))
    looked.tab("Detections")
    looked.until(is_told)


def test_what_was_stepped_through_is_shown_on_as_soon_as_it_plays(looked):
    looked.go()
    for _ in range(30):
        looked.drawn_after(lambda: looked.press("Step"))
    paused = looked.place
    looked.press("Play")
    looked.page.wait_for_timeout(1000)
    assert looked.place != paused


def test_colours_that_are_put_back_leave_nothing_of_the_others(looked):
    looked.go()

    def picture() -> np.ndarray:
        return imread(BytesIO(looked.page.locator("#tiles").screenshot()))

    before = picture()

    def apart() -> float:
        return abs(picture() - before).max()

    looked.press("Dark")
    looked.until(lambda: apart() > 0.5)
    looked.press("Dark")
    looked.until(lambda: apart() < 0.02)  # rounded corners are 2 of 255 off
