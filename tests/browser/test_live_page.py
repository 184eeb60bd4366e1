"""Live page in a browser: layout, playback, editing, keyboard and colours."""

from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread

from conftest import is_apart
from dechirp.processing.cfar.cell_averaging import SmallestOf
from nightly import nightly

TILES = ("scene", "range_doppler", "range_azimuth", "beat", "cut", "micro_doppler")


@nightly
@pytest.mark.parametrize("live_page", ["1280x720", "1920x1080"], indirect=True)
@pytest.mark.parametrize("shade", ["light", "dark"])
def test_tiles_fit_screen_without_overlap(live_page, shade):
    live_page.page.emulate_media(color_scheme=shade)
    live_page.open()
    size = live_page.page.viewport_size
    boxes = {name: live_page.page.locator(f"[data-part={name}]").bounding_box() for name in TILES}
    for name, box in boxes.items():
        assert box["width"] > 250 and box["height"] > 200, name
        assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"], name
        assert box["y"] >= 0 and box["y"] + box["height"] <= size["height"], name
        for other_name, other_box in boxes.items():
            assert name == other_name or is_apart(box, other_box), (name, other_name)
    scroll_size = live_page.page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    )
    assert scroll_size == [size["width"], size["height"]]
    assert live_page.page.evaluate("document.documentElement.dataset.shade") == shade
    live_page.wait_until(lambda: len(set(live_page.rule_colours)) == 1)
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    live_page.save_screenshot(f"live-{shade}-{size['width']}")


def test_plays_pauses_steps_and_rewinds_to_same_frame(shared_page):
    assert shared_page.frame_label.startswith("frame 0,")
    first_data = shared_page.read_figure_data("beat")
    n_frames = shared_page.n_frames
    shared_page.press_button("Play")
    shared_page.wait_until(lambda: shared_page.n_frames > n_frames + 3)
    shared_page.save_screenshot("playing")
    shared_page.press_button("Pause")
    shared_page.page.get_by_role("button", name="Play", exact=True).wait_for()
    paused_label = shared_page.frame_label
    shared_page.press_button("Step")
    shared_page.wait_until(lambda: shared_page.frame_label != paused_label)
    assert shared_page.read_figure_data("beat") != first_data
    shared_page.press_button("Rewind")
    shared_page.wait_until(lambda: shared_page.frame_label.startswith("frame 0,"))
    shared_page.wait_until(lambda: shared_page.read_figure_data("beat") == first_data)


def test_frame_keeps_elements_of_tables_and_style_sheets_of_maps(shared_page):
    """Bokeh would rebuild the tables, and let the browser compute all styles of a map again."""
    shared_page.act_and_wait_for_frame(lambda: shared_page.press_button("Step"))
    shared_page.page.evaluate(_WATCH_JS)
    shared_page.act_and_wait_for_frame(lambda: shared_page.press_button("Step"))
    shared_page.wait_until(
        lambda: shared_page.page.evaluate("() => window.watched.nTableTexts > 0")
    )
    assert shared_page.page.evaluate("() => window.watched.table.isConnected")
    assert shared_page.page.evaluate("() => window.watched.nStyleSheets") == 0


_WATCH_JS = """() => {
  const table = findView("detections-rows").markup_el;
  window.watched = { table, nTableTexts: 0, nStyleSheets: 0 };
  const watch = (element, count) => new MutationObserver((changes) => {
    window.watched[count] += changes.length;
  }).observe(element, { childList: true, subtree: true });
  watch(table, "nTableTexts");
  for (const view of findView("range_doppler").renderer_views.values()) {
    const isAtRest = view.model.type === "Grid" || view.model.glyph?.type === "Image";
    if (isAtRest) watch(view.el.shadowRoot, "nStyleSheets");
  }
}"""


def test_target_can_be_dragged(shared_page, tmp_path):
    car = _find_target(shared_page.settings, "car")
    x, y, z = car.position_m
    mouse = shared_page.page.mouse
    start, end = (
        shared_page.screen_position("scene", y, x),
        shared_page.screen_position("scene", y + 6, x + 8),
    )
    mouse.move(*start)
    assert shared_page.pointer_in_scene == "grab"
    mouse.down()
    shared_page.page.wait_for_timeout(500)  # Bokeh would take this for a long press
    for part in range(1, 6):
        mouse.move(*(a + (b - a) * part / 5 for a, b in zip(start, end, strict=True)))
    assert shared_page.pointer_in_scene == "grabbing"
    mouse.up()
    # A pixel of the scene view is 0.5 m.
    expected_m = pytest.approx((x + 8, y + 6, z), abs=0.5)
    shared_page.wait_until(
        lambda: _find_target(shared_page.settings, "car").position_m == expected_m
    )
    dragged_car = _find_target(shared_page.download_settings(tmp_path / "after.yaml"), "car")
    assert dragged_car.position_m == expected_m
    assert dragged_car.velocity_m_per_s == car.velocity_m_per_s
    shared_page.save_screenshot("dragged")


@nightly
def test_noise_factor_6_db_higher_raises_map_by_6_db(live_page):
    live_page.open()
    live_page.open_tab("Scene")
    before_db = live_page.median_db
    live_page.act_and_wait_for_frame(
        lambda: live_page.type_setting("radar.hardware.noise_factor", "18 dB")
    )
    # The same noise, scaled; one level is up to 60 dB / 255.
    assert live_page.median_db - before_db == pytest.approx(6, abs=0.5)
    live_page.save_screenshot("more-noise")


@nightly
def test_changed_detector_changes_threshold_and_saved_settings(live_page, tmp_path):
    live_page.open()
    live_page.open_tab("Processing")
    initial_text = live_page.read_text("[data-part=cut]")
    assert "over the threshold" in initial_text
    estimator_knob = live_page.locate_knob("chain.cfar.estimator")
    live_page.act_and_wait_for_frame(lambda: estimator_knob.select_option("smallest-of"))
    assert "over the threshold" in live_page.read_text("[data-part=cut]") != initial_text
    live_page.wait_until(lambda: isinstance(live_page.settings.chain.cfar.estimator, SmallestOf))
    saved_scenario = live_page.download_settings(tmp_path / "after.yaml")
    assert isinstance(saved_scenario.chain.cfar.estimator, SmallestOf)


@nightly
@pytest.mark.parametrize(
    ("path", "text", "fragment"),
    [
        (
            "radar.hardware.noise_factor",
            "loud",
            "expected a number or a ratio, such as 4 or 6 dB",
        ),
        ("scene.targets.car.position", "[48, -3.5, 0]", "48; expected a length, such as 50 m"),
        (
            "scene.targets.car.rcs",
            "__import__('os').getpid()",
            "expected a radar cross section",
        ),
    ],
)
def test_invalid_value_is_reported_and_page_continues(shared_page, path, text, fragment):
    shared_page.open_tab("Scene")
    initial_settings = shared_page.settings
    shared_page.type_setting(path, text)
    note = shared_page.page.locator("[data-part=trouble]")
    note.get_by_text("; expected ").wait_for()
    message = shared_page.read_text("[data-part=trouble]")
    assert path in message and fragment in message, message
    shared_page.page.locator("#page-targets .wrong").filter(has_text="expected").first.wait_for()
    shared_page.save_screenshot("wrong")
    shared_page.locate_knob(path).press("Escape")
    shared_page.act_and_wait_for_frame(lambda: shared_page.press_button("Step"))
    assert shared_page.settings == initial_settings
    assert not note.get_by_text("; expected ").is_visible()


@nightly
def test_rejects_file_outside_folders(live_page):
    live_page.open()
    live_page.open_tab("File")
    area = live_page.page.locator("#page-settings_file textarea")
    area.fill("recording: {path: ../../etc/passwd}\n")
    area.blur()
    live_page.press_button("Apply")
    note = live_page.page.locator("[data-part=trouble]")
    note.get_by_text("a file in the folders of the studio").wait_for()
    assert "root:x:0:" not in live_page.page.content()  # as /etc/passwd begins
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))


@nightly
def test_radar_is_designed_from_requirements_and_used(live_page):
    live_page.open()
    live_page.open_tab("Design")
    answer = live_page.page.locator("#page-requirements")
    live_page.type_setting("range_resolution", "0.5 m")
    live_page.type_setting("max_range", "60 m")
    live_page.type_setting("max_velocity", "20 m/s")
    answer.get_by_role("heading", name="Met", exact=True).wait_for()
    live_page.page.get_by_role("button", name="Use this radar").hover()
    live_page.save_screenshot("design")
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Use this radar"))
    live_page.wait_until(
        lambda: (
            live_page.settings.radar.frame.chirp.range_resolution_m == pytest.approx(0.5, rel=0.01)
        )
    )
    assert live_page.settings.radar.frame.max_velocity_m_per_s >= 20


@nightly
def test_keyboard_plays_changes_setting_and_opens_tab(live_page):
    live_page.open()
    keys = live_page.page.keyboard
    _move_focus_to(live_page, "Play")
    keys.press("Space")
    live_page.wait_until(lambda: live_page.n_frames > 3)
    keys.press("Space")
    _move_focus_to(live_page, "Main")
    keys.press("ArrowRight")
    keys.press("ArrowRight")
    assert live_page.focused_name == "Radar"
    _move_focus_to(live_page, "radar.frame.chirp.slope")
    live_page.act_and_wait_for_frame(
        lambda: live_page.page.evaluate(
            "Bokeh.documents[0].get_model_by_name('browser').step_keys += 1"
        )
    )
    assert live_page.focused_name == "radar.frame.chirp.slope"  # tables do not take the focus
    keys.press("Control+A")
    keys.type("20 MHz/us")
    keys.press("Enter")
    live_page.wait_until(
        lambda: live_page.settings.radar.frame.chirp.slope_hz_per_s == pytest.approx(20e12)
    )


@nightly
def test_page_is_loaded_again_after_back_and_reports_lost_connection(live_page):
    live_page.page.add_init_script(_REMEMBER_SOCKETS_JS)
    live_page.open("teach/1")
    first_root = "Bokeh.documents[0].roots()[0].id"
    initial_root = live_page.page.evaluate(first_root)
    live_page.page.goto(f"{live_page.address}healthz")
    live_page.page.wait_for_timeout(15_000)  # the server has long forgotten the session
    live_page.page.go_back()
    live_page.wait_until(lambda: live_page.n_frames > 0)
    assert live_page.page.evaluate(first_root) != initial_root  # another session
    n_frames = live_page.n_frames
    live_page.page.locator("#tries").get_by_role("button").last.click()
    live_page.wait_until(lambda: live_page.n_frames > n_frames)
    live_page.page.evaluate("window.sockets.at(-1).close()")
    live_page.page.get_by_role("alert").filter(has_text="was lost").wait_for()
    live_page.save_screenshot("lost")
    live_page.page.get_by_role("button", name="Load the page again").click()
    live_page.wait_until(lambda: live_page.n_frames > 0)
    assert live_page.page.get_by_role("alert").count() == 0


_REMEMBER_SOCKETS_JS = """
  window.sockets = [];
  window.WebSocket = class extends WebSocket {
    constructor(...a) { super(...a); sockets.push(this); }
  };
"""


@nightly
def test_closing_playing_page_leaves_other_pages_running(live_page):
    live_page.open()
    other_page = live_page.context.new_page()
    other_page.goto(live_page.address)
    frames = "() => window.dechirp?.ready ? window.dechirp.frames : 0"
    live_page.wait_until(lambda: other_page.evaluate(frames) > 0)
    other_page.get_by_role("button", name="Play", exact=True).click()
    live_page.wait_until(lambda: other_page.evaluate(frames) > 3)
    other_page.close()
    for _ in range(3):
        live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    assert live_page.frame_label.startswith("frame 3,")


def _find_target(scenario, name: str):
    return next(target for target in scenario.scene.targets if target.name == name)


def _move_focus_to(live_page, name: str) -> None:
    """Press Tab until the named element has the focus."""
    for _ in range(60):
        live_page.page.keyboard.press("Tab")
        if live_page.focused_name == name:
            return
    raise AssertionError(f"Tab does not reach {name}")


_TABLE_ROWS_JS = """(name) => {
  const { text } = Bokeh.documents[0].get_model_by_name(`${name}-rows`);
  const parsed = new DOMParser().parseFromString(text, "text/html");
  return [...parsed.querySelectorAll("tbody tr")]
    .map((row) => [row.cells[0].textContent, row.hasAttribute("aria-current")]);
}"""
"""Range and mark of each row of a table, as the server wrote them."""


def test_rows_are_picked_by_click_and_arrows(shared_page):
    page = shared_page.page
    shared_page.act_and_wait_for_frame(lambda: shared_page.press_button("Step"))

    def marked_rows() -> list[int]:
        rows = page.evaluate(_TABLE_ROWS_JS, "detections")
        return [index for index, (_, is_marked) in enumerate(rows) if is_marked]

    page.locator("[data-part=detections] tbody tr").nth(1).click()
    shared_page.wait_until(lambda: marked_rows() == [1])
    page.keyboard.press("ArrowUp")
    shared_page.wait_until(lambda: marked_rows() == [0])
    page.keyboard.press("ArrowUp")  # there is none above
    page.keyboard.press("ArrowDown")
    shared_page.wait_until(lambda: marked_rows() == [1])
    assert page.locator("[data-part=detections] tr[aria-current]").count() == 1


@nightly
def test_table_rows_follow_frame_with_equal_count_or_hidden_tab(live_page):
    live_page.open()

    def shows_ranges() -> bool:
        table_text = live_page.read_text("[data-part=detections]")
        rows = live_page.page.evaluate(_TABLE_ROWS_JS, "detections")
        return len(rows) > 0 and all(range_m in table_text for range_m, _ in rows)

    range_columns = set()
    for _ in range(4):
        live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
        live_page.wait_until(shows_ranges)
        rows = live_page.page.evaluate(_TABLE_ROWS_JS, "detections")
        range_columns.add(tuple(range_m for range_m, _ in rows))
    assert len(range_columns) == 4 and len({len(value) for value in range_columns}) < 4
    live_page.open_tab("Findings")
    live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    live_page.open_tab("Detections")
    live_page.wait_until(shows_ranges)


@nightly
def test_play_continues_within_one_second_after_many_steps(live_page):
    live_page.open()
    for _ in range(30):
        live_page.act_and_wait_for_frame(lambda: live_page.press_button("Step"))
    paused_label = live_page.frame_label
    live_page.press_button("Play")
    live_page.page.wait_for_timeout(1000)
    assert live_page.frame_label != paused_label


@nightly
def test_toggling_dark_mode_twice_restores_colours(live_page):
    live_page.open()

    def take_screenshot() -> np.ndarray:
        return imread(BytesIO(live_page.page.locator("#tiles").screenshot()))

    initial_image = take_screenshot()

    def max_difference() -> float:
        return abs(take_screenshot() - initial_image).max()

    while max_difference() > 0:  # tiles still settle after the first frame
        initial_image = take_screenshot()

    live_page.press_button("Dark")
    live_page.wait_until(lambda: max_difference() > 0.5)
    live_page.press_button("Dark")
    # The first layout places lines some 0.01 pixels elsewhere than all later ones: their edges
    # differ by up to 16 of 255. Other colours differ by over 25.
    live_page.wait_until(lambda: max_difference() < 0.08)
