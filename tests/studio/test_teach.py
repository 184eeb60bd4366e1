"""What the lessons show is true: their numbers against the formulas beside them."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.models import Button, Slider

from dechirp.certificate.sensitivity import theoretical_curve
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.studio.scenario_edits import PageLimits
from dechirp.studio.teach import (
    LESSONS,
    chirp,
    doppler,
    echo,
    lesson_builders,
    mixer_demo,
    noise,
    trials,
)
from dechirp.theory import confidence_intervals

UNTOUCHED = {lesson: {k: v.first for k, v in lesson.knobs.items()} for lesson in LESSONS}


def settings(lesson, **turned):
    return lesson().build_settings({**UNTOUCHED[lesson], **turned})


# 1. The chirp.


@pytest.mark.parametrize("turned", [{}, {"range_m": 120}, {"bandwidth_mhz": 300}])
def test_the_beat_that_is_seen_has_the_frequency_2_s_r_over_c(turned):
    at = settings(chirp.ChirpLesson, **turned)
    seen = chirp.compute_chirp_frame(at)
    slope = at.bandwidth_mhz / at.duration_us * 1e12
    assert seen.beat_hz == pytest.approx(2 * slope * at.range_m / SPEED_OF_LIGHT, rel=1e-6)


def test_the_ramp_that_is_seen_rises_by_its_bandwidth_and_the_echo_follows_late():
    seen = chirp.compute_chirp_frame(settings(chirp.ChirpLesson, range_m=150))
    slope = np.polyfit(seen.sent_s, seen.sent_hz, 1)[0]
    assert slope == pytest.approx(150e6 / 7.3e-6, rel=1e-6)
    assert seen.echo_s[0] - seen.sent_s[0] == pytest.approx(300 / SPEED_OF_LIGHT)
    assert seen.beat_s[0] >= 300 / SPEED_OF_LIGHT


def test_before_the_echo_is_there_nothing_beats():
    seen = chirp.compute_chirp_frame(settings(chirp.ChirpLesson, range_m=200, elapsed=10))
    assert seen.beat.size == 0
    assert np.isnan(seen.beat_hz)


@pytest.mark.parametrize("duration_us", [5, 14.6])
def test_a_range_cell_more_is_a_cycle_more_whatever_the_duration(duration_us):
    at = {"duration_us": duration_us, "bandwidth_mhz": 200}
    near, far = (
        chirp.compute_chirp_frame(settings(chirp.ChirpLesson, range_m=range_m, **at))
        for range_m in (60, 80)
    )
    cells = 20 / (SPEED_OF_LIGHT / (2 * 200e6))
    cycles = (far.beat_hz - near.beat_hz) * duration_us * 1e-6
    assert cycles == pytest.approx(cells, rel=1e-6)


# 2. Target and range transform.


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_the_strongest_bin_lies_within_half_a_bin_of_the_target(window):
    for range_m in (43.2, 50.5, 57.9):
        seen = echo.compute_echo_frame(settings(echo.EchoLesson, range_m=range_m, window=window))
        assert abs(seen.peak_m - range_m) <= SPEED_OF_LIGHT / (2 * 150e6) / 2 + 1e-9


def test_padding_adds_bins_on_the_same_curve_and_parts_no_targets():
    one, eight = (
        echo.compute_echo_frame(settings(echo.EchoLesson, range_m=50.5, padding=padding))
        for padding in ("1", "8")
    )
    assert eight.bins[::8] == pytest.approx(one.bins, rel=1e-4, abs=1e-9)
    assert to_decibels(eight.bins.max()) == pytest.approx(0, abs=0.1)
    assert to_decibels(one.bins.max()) < -3


def test_a_weak_target_hides_among_sidelobes_and_hann_shows_it():
    hidden, shown = (
        echo.compute_echo_frame(
            settings(
                echo.EchoLesson,
                range_m=50.5,
                window=window,
                second_target="40 dB weaker, 8 m behind",
            )
        )
        for window in ("rectangular", "hann")
    )

    def level_db(seen, range_m):
        return to_decibels(seen.fine[np.argmin(abs(seen.fine_m - range_m))])

    assert level_db(shown, 58.5) == pytest.approx(-40, abs=0.5)
    # Higher than its two sides by much under Hann, and lost under the others.
    assert min(level_db(shown, 58.5) - level_db(shown, at_m) for at_m in (55.5, 61.5)) > 10
    assert level_db(hidden, 55.0) > -40


def test_half_of_the_samples_make_bins_twice_as_wide():
    whole, half = (
        echo.compute_echo_frame(settings(echo.EchoLesson, n_samples=n)).chirp.range_resolution_m
        for n in (2200, 1100)
    )
    assert half == pytest.approx(2 * whole)


# 3. Many chirps.


def column_of(velocity, ramp, sampling):
    at = settings(doppler.DopplerLesson, velocity_m_per_s=velocity, ramp=ramp)
    made = mixer_demo.compute_mixer_frame(at, sampling, number=0)
    return made.velocity_m_per_s, made.power[:, made.column]


def mirrored(power):
    """The row of each velocity's opposite; the first has none."""
    return power[1:][::-1]


def test_without_a_ramp_one_mixer_shows_both_signs_alike():
    for velocity in (20, -20):
        bins, power = column_of(velocity, mixer_demo.NO_RAMP, "real")
        assert mirrored(power) == pytest.approx(power[1:], rel=1e-3)
        assert abs(bins[np.argmax(power)]) == pytest.approx(20, abs=1.1)


def test_without_a_ramp_two_mixers_tell_the_signs_apart():
    for velocity in (20, -20):
        bins, power = column_of(velocity, mixer_demo.NO_RAMP, "complex")
        assert bins[np.argmax(power)] == pytest.approx(velocity, abs=1.1)
        assert to_decibels(power.max() / mirrored(power)[np.argmax(power) - 1]) > 25


@pytest.mark.parametrize("sampling", ["real", "complex"])
def test_with_a_ramp_even_one_mixer_keeps_the_sign(sampling):
    for velocity in (20, -20):
        bins, power = column_of(velocity, mixer_demo.RAMP, sampling)
        assert bins[np.argmax(power)] == pytest.approx(velocity, abs=1.1)


def test_the_phase_of_the_beat_turns_with_the_doppler_frequency():
    at = settings(doppler.DopplerLesson, velocity_m_per_s=20)
    made = mixer_demo.compute_mixer_frame(at, "complex", number=0)
    frame = at.radar("complex").frame
    turns = np.unwrap(made.phase_turns, period=1)
    per_chirp = np.polyfit(np.arange(turns.size), turns, 1)[0]
    right = 2 * 20 / frame.chirp.wavelength_m * frame.repetition_s
    assert per_chirp == pytest.approx(right, rel=0.01)


def test_one_mixer_on_a_carrier_turns_its_phase_by_half_turns_only():
    at = settings(doppler.DopplerLesson, ramp=mixer_demo.NO_RAMP)
    turns = mixer_demo.compute_mixer_frame(at, "real", number=0).phase_turns
    assert np.all((abs(turns) < 1e-6) | (abs(abs(turns) - 0.5) < 1e-6))
    assert 0 < np.mean(abs(turns) < 0.25) < 1


def test_false_alarms_are_as_many_as_asked_for():
    at = settings(doppler.DopplerLesson, false_alarms="1e-3")
    frames = [mixer_demo.compute_mixer_frame(at, "complex", number) for number in range(4)]
    n_over = sum(frame.n_false_alarms for frame in frames)
    # Neighbouring cells exceed together under Hann windows: three times the spread of Poisson.
    expected = 1e-3 * sum(frame.n_tested for frame in frames)
    assert n_over == pytest.approx(expected, abs=4 * np.sqrt(3 * expected))


def test_without_guard_cells_the_target_raises_its_own_threshold():
    guarded, bare = (
        mixer_demo.compute_mixer_frame(
            settings(doppler.DopplerLesson, guard=guard), "complex", number=0
        )
        for guard in ("4 cells", "none")
    )
    row = np.argmax(guarded.power[:, guarded.column])
    raised = bare.threshold[row, bare.column] / guarded.threshold[row, guarded.column]
    assert to_decibels(raised) > 6


def test_a_frame_that_is_not_whole_is_not_searched():
    at = settings(doppler.DopplerLesson, n_chirps=64)
    assert mixer_demo.compute_mixer_frame(at, "complex", number=0).threshold is None


# 4. Noise.


def found(snr_db, n_looks, window="rectangular"):
    looks = [trials.detection_hits(snr_db, window, number) for number in range(n_looks)]
    return (np.concatenate(each) for each in zip(*looks, strict=True))


def test_below_its_limit_the_rule_of_the_report_is_blind_where_cell_averaging_misses_nothing():
    ours, theirs = found(-25.0, 12)
    assert ours.mean() == 1
    at_most = confidence_intervals.binomial_interval(
        int(theirs.sum()), theirs.size, confidence=0.999
    )[1]
    assert at_most < theoretical_curve("rectangular")(np.array(-25.0))


@pytest.mark.parametrize("snr_db", [-40.0, -42.0])
def test_the_right_detector_finds_the_target_as_often_as_theory_says(snr_db):
    ours, theirs = found(snr_db, 25)
    low, high = confidence_intervals.binomial_interval(
        int(ours.sum()), ours.size, confidence=0.9999
    )
    assert low <= theoretical_curve("rectangular")(np.array(snr_db)) <= high
    assert not theirs.any()


def test_both_transforms_gain_54_db_less_what_lies_between_the_bins():
    at = settings(noise.NoiseLesson, snr_db=-40)
    gain_db = to_decibels(2200 * 128)
    assert gain_db - 0.6 < trials.snr_in_cell_db(at) + 40 < gain_db


def test_the_cut_shows_what_was_counted():
    for number in range(3):
        cut = trials.chain_cut(-41.0, "rectangular", number)
        at = np.argmin(abs(cut.range_m - 50.0))
        near = slice(at - 1, at + 2)
        seen = bool((cut.power[near] > cut.threshold[near]).any())
        assert seen == trials.detection_hits(-41.0, "rectangular", number)[0][0]


def test_the_thresholds_lie_where_theory_puts_them_over_the_noise():
    assert to_decibels(trials.report_cut(-60.0, 0).threshold.mean()) == pytest.approx(29, abs=0.3)
    ours = trials.chain_cut(-60.0, "rectangular", 0).threshold
    assert to_decibels(ours.mean()) == pytest.approx(11.45, abs=0.2)


def test_a_look_that_is_shown_again_counts_once():
    tally, at = trials.HitCounter(), settings(noise.NoiseLesson, snr_db=-40)
    first, second = (trials.compute_noise_frame(at, number) for number in (0, 1))
    for seen in (first, first, second):
        tally.add(seen)
    ((snr_db, share, low, high, n),) = tally.hit_rates("rectangular", "chain")
    assert (snr_db, n) == (-40, 2 * trials.N_FRAMES)
    assert low < share == (first.hits.sum() + second.hits.sum()) / n <= high


# The pages.


@pytest.fixture
def worker():
    with ThreadPoolExecutor(1) as made:
        yield made


@pytest.mark.parametrize("lesson", LESSONS)
def test_everything_to_try_can_be_set_and_shown(lesson):
    made = lesson()
    for one in made.experiments:
        assert set(one.knob_values) <= set(made.knobs)
        at = settings(lesson, **one.knob_values)
        for name, wanted in one.knob_values.items():
            assert getattr(at, name) == wanted
        numbers = made.show_frame(made.compute_frame(at, 0))
        assert not any("nan" in number for number in numbers.values())


@pytest.mark.parametrize("lesson", LESSONS)
def test_whatever_a_browser_sends_is_kept_within_bounds(lesson):
    for sent in (1e9, -1e9, float("nan"), "1e9", None, [], {}):
        at = settings(lesson, **dict.fromkeys(lesson.knobs, sent))
        for name, knob in lesson.knobs.items():
            taken = getattr(at, name)
            bounds = getattr(knob, "options", None)
            assert taken in bounds if bounds else knob.start <= taken <= knob.end


@pytest.mark.parametrize("lesson", LESSONS)
def test_play_goes_from_end_to_end_and_begins_again(lesson):
    made = lesson()
    name, by = made.animated_dial
    dial, values, seen = made.knobs[name], dict(UNTOUCHED[lesson]), []
    for _ in range(round(2 * (dial.end - dial.start) / abs(by)) + 2):
        values |= made.next_values(values)
        seen.append(values[name])
    assert min(seen) == dial.start
    assert max(seen) == dial.end


@pytest.mark.parametrize("lesson", [doppler.DopplerLesson, noise.NoiseLesson])
def test_play_can_stay_where_it_is_and_only_bring_new_noise(lesson):
    _, stays = lesson.knobs["play"].options
    made = lesson()
    values = {**UNTOUCHED[lesson], "play": stays}
    assert made.next_values(values) == {}
    first, second = (made.compute_frame(made.build_settings(values), number) for number in (0, 1))
    powers = [
        (seen.two_mixers if lesson is doppler.DopplerLesson else seen.chain).power
        for seen in (first, second)
    ]
    assert not np.array_equal(*powers)


def test_each_lesson_has_an_address_and_a_page_of_its_own(worker):
    made = lesson_builders(worker, PageLimits())
    assert list(made) == ["/teach/1", "/teach/2", "/teach/3", "/teach/4"]
    for number, (fill, lesson) in enumerate(zip(made.values(), LESSONS, strict=True), start=1):
        document = Document()
        fill(document)
        assert document.template_variables["number"] == number
        assert len(list(document.select({"type": Button}))) == 1 + len(lesson.experiments)
        for slider in document.select({"type": Slider}):
            # Units stand in the title, after a comma, but for what is counted.
            assert "," in slider.title or "of" in slider.title


def test_a_page_of_a_lesson_asks_for_nothing_from_outside(worker):
    document = Document()
    lesson_builders(worker, PageLimits())["/teach/1"](document)
    text = document.template
    assert "http" not in text
    assert "http" not in document.template_variables["script"]
