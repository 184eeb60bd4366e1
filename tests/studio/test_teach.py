"""Lessons of the studio: displayed numbers against formulas, knobs and pages."""

import asyncio
import re
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.models import Button, Slider

from dechirp.certificate.sensitivity import theoretical_curve
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.studio.browser_events import BrowserState
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.teach import (
    LESSONS,
    chirp,
    doppler,
    echo,
    lesson_page_builders_by_address,
    mixer_demo,
    noise,
    page,
    trials,
)
from dechirp.studio.views.line_figure import LineFigure
from dechirp.theory import confidence_intervals
from nightly import nightly, nightly_except

INITIAL_KNOB_VALUES = {lesson: {k: v.first for k, v in lesson.knobs.items()} for lesson in LESSONS}


def build_lesson_settings(lesson, **knob_values):
    return lesson().build_settings({**INITIAL_KNOB_VALUES[lesson], **knob_values})


# 1. The chirp.


@pytest.mark.parametrize("knob_values", [{}, {"range_m": 120}, {"bandwidth_mhz": 300}])
def test_beat_frequency_equals_2_s_r_over_c(knob_values):
    lesson_settings = build_lesson_settings(chirp.ChirpLesson, **knob_values)
    frame = chirp.compute_ramps_and_beat(lesson_settings)
    slope = lesson_settings.bandwidth_mhz / lesson_settings.duration_us * 1e12
    assert frame.beat_hz == pytest.approx(
        2 * slope * lesson_settings.range_m / SPEED_OF_LIGHT, rel=1e-6
    )


def test_ramp_rises_by_bandwidth_and_echo_is_delayed():
    frame = chirp.compute_ramps_and_beat(build_lesson_settings(chirp.ChirpLesson, range_m=150))
    slope = np.polyfit(frame.sent_s, frame.sent_hz, 1)[0]
    assert slope == pytest.approx(150e6 / 7.3e-6, rel=1e-6)
    assert frame.echo_s[0] - frame.sent_s[0] == pytest.approx(300 / SPEED_OF_LIGHT)
    assert frame.beat_s[0] >= 300 / SPEED_OF_LIGHT


def test_no_beat_before_echo_arrives():
    frame = chirp.compute_ramps_and_beat(
        build_lesson_settings(chirp.ChirpLesson, range_m=200, elapsed=10)
    )
    assert frame.beat.size == 0
    assert np.isnan(frame.beat_hz)


@pytest.mark.parametrize("duration_us", [5, 14.6])
def test_each_range_cell_adds_one_beat_cycle_per_chirp(duration_us):
    knob_values = {"duration_us": duration_us, "bandwidth_mhz": 200}
    near, far = (
        chirp.compute_ramps_and_beat(
            build_lesson_settings(chirp.ChirpLesson, range_m=range_m, **knob_values)
        )
        for range_m in (60, 80)
    )
    cells = 20 / (SPEED_OF_LIGHT / (2 * 200e6))
    cycles = (far.beat_hz - near.beat_hz) * duration_us * 1e-6
    assert cycles == pytest.approx(cells, rel=1e-6)


# 2. Target and range transform.


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_strongest_bin_is_within_half_bin_of_target(window):
    for range_m in (43.2, 50.5, 57.9):
        frame = echo.compute_echo_and_spectrum(
            build_lesson_settings(echo.EchoLesson, range_m=range_m, window=window)
        )
        assert abs(frame.strongest_range_m - range_m) <= SPEED_OF_LIGHT / (2 * 150e6) / 2 + 1e-9


def test_zero_padding_interpolates_same_spectrum():
    unpadded, padded = (
        echo.compute_echo_and_spectrum(
            build_lesson_settings(echo.EchoLesson, range_m=50.5, padding=padding)
        )
        for padding in ("1", "8")
    )
    assert padded.bins[::8] == pytest.approx(unpadded.bins, rel=1e-4, abs=1e-9)
    assert to_decibels(padded.bins.max()) == pytest.approx(0, abs=0.1)
    assert to_decibels(unpadded.bins.max()) < -3


def test_hann_window_reveals_weak_target_among_sidelobes():
    rectangular, hann = (
        echo.compute_echo_and_spectrum(
            build_lesson_settings(
                echo.EchoLesson,
                range_m=50.5,
                window=window,
                second_target="40 dB weaker, 8 m behind",
            )
        )
        for window in ("rectangular", "hann")
    )

    def level_db(frame, range_m):
        return to_decibels(frame.fine[np.argmin(abs(frame.fine_m - range_m))])

    assert level_db(hann, 58.5) == pytest.approx(-40, abs=0.5)
    # Hann: 10 dB above both sides of the peak. Rectangular: below the sidelobes.
    assert (
        min(level_db(hann, 58.5) - level_db(hann, neighbour_m) for neighbour_m in (55.5, 61.5)) > 10
    )
    assert level_db(rectangular, 55.0) > -40


def test_halving_samples_doubles_range_resolution():
    full_m, half_m = (
        echo.compute_echo_and_spectrum(
            build_lesson_settings(echo.EchoLesson, n_samples=n)
        ).chirp.range_resolution_m
        for n in (2200, 1100)
    )
    assert half_m == pytest.approx(2 * full_m)


# 3. Many chirps.


def compute_doppler_column(velocity, ramp, sampling):
    lesson_settings = build_lesson_settings(
        doppler.DopplerLesson, velocity_m_per_s=velocity, ramp=ramp
    )
    frame = mixer_demo.compute_map_and_phases(lesson_settings, sampling, frame_number=0)
    return frame.velocity_m_per_s, frame.power[:, frame.column]


def mirror_velocities(power):
    """Return the power at the opposite of each velocity; the first row has none."""
    return power[1:][::-1]


def test_real_mixer_without_ramp_cannot_resolve_velocity_sign():
    for velocity in (20, -20):
        bins, power = compute_doppler_column(velocity, mixer_demo.NO_RAMP, "real")
        assert mirror_velocities(power) == pytest.approx(power[1:], rel=1e-3)
        assert abs(bins[np.argmax(power)]) == pytest.approx(20, abs=1.1)


def test_quadrature_mixer_without_ramp_resolves_velocity_sign():
    for velocity in (20, -20):
        bins, power = compute_doppler_column(velocity, mixer_demo.NO_RAMP, "complex")
        assert bins[np.argmax(power)] == pytest.approx(velocity, abs=1.1)
        assert to_decibels(power.max() / mirror_velocities(power)[np.argmax(power) - 1]) > 25


@pytest.mark.parametrize("sampling", nightly_except(1, ["real", "complex"]))
def test_ramp_resolves_velocity_sign_with_any_mixer(sampling):
    for velocity in (20, -20):
        bins, power = compute_doppler_column(velocity, mixer_demo.RAMP, sampling)
        assert bins[np.argmax(power)] == pytest.approx(velocity, abs=1.1)


def test_beat_phase_advances_with_doppler_frequency():
    lesson_settings = build_lesson_settings(doppler.DopplerLesson, velocity_m_per_s=20)
    mixer_frame = mixer_demo.compute_map_and_phases(lesson_settings, "complex", frame_number=0)
    frame = lesson_settings.radar("complex").frame
    turns = np.unwrap(mixer_frame.phase_turns, period=1)
    per_chirp = np.polyfit(np.arange(turns.size), turns, 1)[0]
    expected = 2 * 20 / frame.chirp.wavelength_m * frame.repetition_s
    assert per_chirp == pytest.approx(expected, rel=0.01)


def test_real_mixer_without_ramp_has_phase_of_zero_or_half_turn():
    lesson_settings = build_lesson_settings(doppler.DopplerLesson, ramp=mixer_demo.NO_RAMP)
    turns = mixer_demo.compute_map_and_phases(lesson_settings, "real", frame_number=0).phase_turns
    assert np.all((abs(turns) < 1e-6) | (abs(abs(turns) - 0.5) < 1e-6))
    assert 0 < np.mean(abs(turns) < 0.25) < 1


def test_number_of_false_alarms_matches_setting():
    lesson_settings = build_lesson_settings(doppler.DopplerLesson, false_alarms="1e-3")
    frames = [
        mixer_demo.compute_map_and_phases(lesson_settings, "complex", number) for number in range(4)
    ]
    n_over = sum(frame.n_false_alarms for frame in frames)
    # Hann windows correlate neighbouring cells: three times the variance of Poisson.
    expected = 1e-3 * sum(frame.n_tested for frame in frames)
    assert n_over == pytest.approx(expected, abs=4 * np.sqrt(3 * expected))


def test_missing_guard_cells_cause_self_masking():
    guarded, unguarded = (
        mixer_demo.compute_map_and_phases(
            build_lesson_settings(doppler.DopplerLesson, guard=guard), "complex", frame_number=0
        )
        for guard in ("4 cells", "none")
    )
    row = np.argmax(guarded.power[:, guarded.column])
    threshold_ratio = (
        unguarded.threshold[row, unguarded.column] / guarded.threshold[row, guarded.column]
    )
    assert to_decibels(threshold_ratio) > 6


def test_incomplete_frame_has_no_threshold():
    lesson_settings = build_lesson_settings(doppler.DopplerLesson, n_chirps=64)
    assert (
        mixer_demo.compute_map_and_phases(lesson_settings, "complex", frame_number=0).threshold
        is None
    )


# 4. Noise.


def simulate_hits(snr_db, n_frames, window="rectangular"):
    hits_per_trial = [
        trials.simulate_cfar_and_report_rule_hits(snr_db, window, number)
        for number in range(n_frames // trials.N_FRAMES)
    ]
    return (np.concatenate(hits) for hits in zip(*hits_per_trial, strict=True))


@nightly
def test_report_rule_misses_target_that_cell_averaging_always_detects():
    chain_hits, report_hits = simulate_hits(-25.0, 48)
    assert chain_hits.mean() == 1
    upper_bound = confidence_intervals.binomial_interval(
        int(report_hits.sum()), report_hits.size, confidence=0.999
    )[1]
    assert upper_bound < theoretical_curve("rectangular")(np.array(-25.0))


@nightly
@pytest.mark.parametrize("snr_db", [-40.0, -42.0])
def test_cell_averaging_detection_rate_matches_theory(snr_db):
    chain_hits, report_hits = simulate_hits(snr_db, 100)
    low, high = confidence_intervals.binomial_interval(
        int(chain_hits.sum()), chain_hits.size, confidence=0.9999
    )
    assert low <= theoretical_curve("rectangular")(np.array(snr_db)) <= high
    assert not report_hits.any()


def test_transforms_gain_54_db_minus_straddling_loss():
    lesson_settings = build_lesson_settings(noise.NoiseLesson, snr_db=-40)
    gain_db = to_decibels(2200 * 128)
    assert gain_db - 0.6 < trials.snr_in_cell_db(lesson_settings) + 40 < gain_db


def test_cut_agrees_with_counted_hit():
    for number in range(3):
        cut = trials.cell_averaging_range_cut(-41.0, "rectangular", number)
        index = np.argmin(abs(cut.range_m - 50.0))
        neighbourhood = slice(index - 1, index + 2)
        frame = bool((cut.power[neighbourhood] > cut.threshold[neighbourhood]).any())
        assert (
            frame == trials.simulate_cfar_and_report_rule_hits(-41.0, "rectangular", number)[0][0]
        )


def test_thresholds_over_noise_match_theory():
    assert to_decibels(trials.report_rule_range_cut(-60.0, 0).threshold.mean()) == pytest.approx(
        29, abs=0.3
    )
    chain_hits = trials.cell_averaging_range_cut(-60.0, "rectangular", 0).threshold
    assert to_decibels(chain_hits.mean()) == pytest.approx(11.45, abs=0.2)


@nightly
def test_repeated_trial_counts_once():
    tally, lesson_settings = (
        trials.HitCounter(),
        build_lesson_settings(noise.NoiseLesson, snr_db=-40),
    )
    first, second = (trials.compute_cuts_and_hits(lesson_settings, number) for number in (0, 1))
    for frame in (first, first, second):
        tally.add_hits_of_frame(frame)
    ((snr_db, hit_rate, low, high, n),) = tally.hit_rates_with_intervals("rectangular", "chain")
    assert (snr_db, n) == (-40, 2 * trials.N_FRAMES)
    assert low < hit_rate == (first.hits.sum() + second.hits.sum()) / n <= high


# The pages.


@pytest.fixture
def worker():
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.mark.parametrize("lesson", nightly_except(1, LESSONS))
def test_every_experiment_can_be_set_and_shown(lesson):
    instance = lesson()
    for experiment in instance.experiments:
        assert set(experiment.knob_values) <= set(instance.knobs)
        lesson_settings = build_lesson_settings(lesson, **experiment.knob_values)
        for name, value in experiment.knob_values.items():
            assert getattr(lesson_settings, name) == value
        numbers = instance.draw_frame_and_format_numbers(instance.compute_frame(lesson_settings, 0))
        assert not any("nan" in number for number in numbers.values())
        drawings = [part for part in vars(instance).values() if isinstance(part, LineFigure)]
        # At 500 pixels, 430 are left beside the axis: 6.5 a character of 12 pixels, bold.
        assert drawings and all(len(drawing.figure.title.text) <= 66 for drawing in drawings)


@pytest.mark.parametrize("lesson", nightly_except(2, LESSONS))
def test_knob_values_from_browser_stay_within_bounds(lesson):
    for sent_value in (1e9, -1e9, float("nan"), "1e9", None, [], {}):
        lesson_settings = build_lesson_settings(lesson, **dict.fromkeys(lesson.knobs, sent_value))
        for name, knob in lesson.knobs.items():
            value = getattr(lesson_settings, name)
            options = getattr(knob, "options", None)
            assert value in options if options else knob.start <= value <= knob.end


@pytest.mark.parametrize("lesson", LESSONS)
def test_play_sweeps_whole_knob_range_and_restarts(lesson):
    instance = lesson()
    name, step = instance.animated_dial
    dial, values, frame = instance.knobs[name], dict(INITIAL_KNOB_VALUES[lesson]), []
    for _ in range(round(2 * (dial.end - dial.start) / abs(step)) + 2):
        values |= instance.next_animated_knob_values(values)
        frame.append(values[name])
    assert min(frame) == dial.start
    assert max(frame) == dial.end


@pytest.mark.parametrize("lesson", [doppler.DopplerLesson, noise.NoiseLesson])
def test_play_can_hold_knobs_and_draw_new_noise(lesson):
    _, hold_option = lesson.knobs["play"].options
    instance = lesson()
    values = {**INITIAL_KNOB_VALUES[lesson], "play": hold_option}
    assert instance.next_animated_knob_values(values) == {}
    first, second = (
        instance.compute_frame(instance.build_settings(values), number) for number in (0, 1)
    )
    powers = [
        (frame.two_mixers if lesson is doppler.DopplerLesson else frame.chain).power
        for frame in (first, second)
    ]
    assert not np.array_equal(*powers)


@nightly
def test_each_lesson_has_its_own_address_and_page(worker):
    builders = lesson_page_builders_by_address(worker, PageLimits())
    assert list(builders) == ["/teach/1", "/teach/2", "/teach/3", "/teach/4"]
    for number, (build_page, lesson) in enumerate(
        zip(builders.values(), LESSONS, strict=True), start=1
    ):
        document = Document()
        build_page(document)
        assert document.template_variables["number"] == number
        assert len(list(document.select({"type": Button}))) == 1 + len(lesson.experiments)
        for slider in document.select({"type": Slider}):
            # Titles contain the unit in parentheses, except those of counts.
            assert "(" in slider.title or "of" in slider.title


def test_lesson_page_loads_no_external_resources(worker):
    document = Document()
    lesson_page_builders_by_address(worker, PageLimits())["/teach/1"](document)
    text = document.template
    assert "http" not in text
    assert "http" not in document.template_variables["script"]


def test_lesson_plays_without_waiting_for_unconfirmed_frames(worker, monkeypatch):
    monkeypatch.setattr(page, "monotonic", lambda: 0.0)  # no frame is ever late
    document = Document()
    lesson_page = page.LessonPage(
        document,
        make=chirp.ChirpLesson,
        number=1,
        n_lessons=1,
        worker=worker,
        limits=PageLimits(),
    )
    (browser,) = document.select({"type": BrowserState})
    lesson_page._toggle_play()

    async def draw_frames(n_rounds: int, *, n_frames: int, confirms: bool) -> None:
        for _ in range(n_rounds):  # more than frames: a slow machine returns without some
            await lesson_page._draw_next()
            # As in page.js.
            if confirms and browser.n_frames_sent % browser.frames_per_confirmation == 0:
                browser.n_frames_drawn = browser.n_frames_sent
            if browser.n_frames_sent == n_frames:
                return

    asyncio.run(draw_frames(400, n_frames=20, confirms=True))
    assert browser.n_frames_sent == 20
    asyncio.run(draw_frames(40, n_frames=40, confirms=False))
    assert browser.n_frames_sent == 23  # a browser that draws none receives no more


@pytest.mark.parametrize("lesson", LESSONS)
def test_lessons_say_whose_report_they_mean(lesson):
    texts = [lesson.introduction, *(words for _, words in lesson.formulas)]
    texts += [part for trial in lesson.experiments for part in (trial.question, trial.answer)]
    for text in texts:
        for before, _ in pairwise(re.split(r"\breport\b", text)):
            assert before.endswith("students' ")
