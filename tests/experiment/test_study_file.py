"""Study files: swept and random settings, round trips and reported mistakes."""

import math
from decimal import Decimal
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.config.quantities import format_shortest_decimal, parse_quantity
from dechirp.core.errors import InvalidFile, InvalidSetting
from dechirp.experiments.study.dumping import dump_study_as_yaml
from dechirp.experiments.study.parsing import load_study
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.study import RandomSetting, Sampling, Study, SweptSetting
from nightly import nightly

SCENARIO = """\
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 3 us, ramp_duration: 29 us,
            sample_rate: 10 MHz, n_samples: 256, sampling: complex}
    n_chirps: 32
    interval: 35 us
  array: {rx: [[0, 0, 0], [0, 2 mm, 0], [0, 4 mm, 0], [0, 6 mm, 0]]}
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: car, position: [60 m, 3 m, 0 m], velocity: [8 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}
    - {name: truck, position: [90 m, -4 m, 0 m], rcs: 20 dBsm}
impairments:
  - {kind: white-noise, snr: -24 dB, target: car}
"""
RCS = "scene.targets.car.rcs: {from: -10 dBsm, to: 20 dBsm, step: 5 dB}"
STUDY = f"""\
scenario: scenario.yaml
seed: 7
vary:
  {RCS}
  chain.range_window: [hann, rectangular]
trials: {{at_most: 100, until: {{score: false_alarm_probability, width: 1e-3}}}}
scores: [false_alarm_probability, track_ospa]
stop_after_failures: 0.01
require:
  - {{score: false_alarm_probability, points: {{scene.targets.car.rcs: 10.0 dBsm}}, at_most: 1e-3}}
  - {{score: track_ospa, at_most: 10 cm, confidence: 0.9}}
"""


@pytest.fixture
def load_text(tmp_path):
    """Return a function that loads a text as a study file next to the scenario."""

    def load_study_text(text, *overrides, scenario=SCENARIO, **options):
        (tmp_path / "scenario.yaml").write_text(scenario)
        (tmp_path / "study.yaml").write_text(text)
        return load_study(tmp_path / "study.yaml", overrides, **options)

    return load_study_text


@pytest.fixture
def load_swept_setting(load_text):
    """Return a function that loads the single varied setting of a study."""

    def load_one_setting(path, values, *overrides, more=""):
        text = (
            f"scenario: scenario.yaml\nscores: [processing_time]\n{more}vary: {{{path}: {values}}}"
        )
        return load_text(text, *overrides).vary[0]

    return load_one_setting


def collect_mistakes(loader, *args, **options):
    """Load a file and return all its mistakes."""
    with pytest.raises(InvalidFile) as error:
        loader(*args, **options)
    for mistake in error.value.mistakes:
        assert mistake.setting and mistake.value and mistake.expected and mistake.fix
        assert mistake.file
    return error.value.mistakes


def test_study_file_is_read_as_written(load_text):
    study = load_text(STUDY)

    rcs, window = study.vary
    assert rcs.texts == tuple(f"{level} dBsm" for level in range(-10, 25, 5))
    assert (rcs.numbers, rcs.unit) == (tuple(range(-10, 25, 5)), "dBsm")
    assert (window.texts, window.numbers, window.unit) == (("hann", "rectangular"), None, "")
    assert (study.seed, study.n_points) == (7, 14)
    assert study.trials.until.width == 1e-3
    first, second = study.require
    assert first.points == (("scene.targets.car.rcs", "10 dBsm"),)  # text as in the swept list
    assert (second.at_most, second.confidence) == (0.1, 0.9)


def test_dumped_study_is_read_back_equal(load_text):
    more = "  scene.targets.truck.position.0: {normal: [90 m, 10 cm]}\n"
    more += "  radar.hardware.noise_factor: {uniform: [10 dB, 14 dB]}\n"
    more += "  impairments: {clear: [{kind: thermal-noise}], 'to: be': []}\n"
    more += "  chain.angle: [null, {kind: fft}]\ndraw: {method: sobol, n: 8}\n"
    study = load_text(STUDY.replace("trials:", more + "trials:", 1))

    text = dump_study_as_yaml(study)
    assert load_text(text) == study
    assert dump_study_as_yaml(load_text(text)) == text


def test_long_range_is_dumped_in_short_form(load_text):
    values = "{from: 1 m, to: 200 m, n: 300, spacing: log}"
    study = load_text(
        "scenario: scenario.yaml\nscores: [processing_time]\ntrials: {at_most: 10}\n"
        f"vary: {{scene.targets.car.position.0: {values}}}"
    )

    text = dump_study_as_yaml(study)
    assert values in text
    assert load_text(text) == study


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ("{from: -45 dB, to: -10 dB, step: 2.5 dB}", [f"{-45 + 2.5 * k:g} dB" for k in range(15)]),
        ("{from: 0 dB, to: 1 dB, step: 0.4 dB}", ["0 dB", "0.4 dB", "0.8 dB"]),
        ("{from: 1, to: 2, step: 0.5}", ["1", "1.5", "2"]),
        ("{from: 1, to: 100, n: 3, spacing: log}", ["1", "10", "100"]),
        ("{from: 1, to: 10 dB, n: 3}", ["0 dB", "5 dB", "10 dB"]),
        ("[1, 3 dB]", ["1", "3 dB"]),
    ],
)
def test_ranges_of_ratios_are_spaced_in_their_unit(load_swept_setting, values, texts):
    assert list(load_swept_setting("impairments.white-noise.snr", values).texts) == texts


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ("{from: 10 cm, to: 0.5 m, step: 20 cm}", ["10 cm", "30 cm", "50 cm"]),
        ("{from: 0, to: 1 km, step: 500 m}", ["0 km", "0.5 km", "1 km"]),
        ("{from: 1 m, to: 100 m, n: 3, spacing: log}", ["1 m", "10 m", "100 m"]),
        ("{from: -1 m, to: 2 m, n: 4}", ["-1 m", "0 m", "1 m", "2 m"]),
        ("{from: 0.1 m, to: 0.7 m, step: 0.1 m}", [f"0.{k} m" for k in range(1, 8)]),
    ],
)
def test_ranges_of_lengths_use_suitable_units(load_swept_setting, values, texts):
    axis = load_swept_setting("scene.targets.truck.position.0", values)

    assert list(axis.texts) == texts
    assert axis.numbers == tuple(float(text.split()[0]) for text in texts)
    assert axis.unit == texts[0].split()[1]


def test_numbers_of_list_are_in_its_first_unit(load_swept_setting):
    axis = load_swept_setting("scene.targets.car.rcs", "[0.1 m^2, 10 dBsm, 1e6 cm2]")

    assert axis.unit == "m^2"
    assert axis.numbers == pytest.approx((0.1, 10, 100), rel=1e-12)


def test_counts_with_log_spacing_are_integers(load_swept_setting):
    axis = load_swept_setting("radar.frame.n_chirps", "{from: 16, to: 256, n: 5, spacing: log}")

    assert axis.texts == ("16", "32", "64", "128", "256")


@nightly
@settings(max_examples=60, deadline=None)
@given(
    low=st.decimals(-1000, 1000, places=3),
    step=st.decimals(Decimal("0.001"), 100, places=3),
    n=st.integers(2, 300),
    short=st.integers(0, 999),
)
def test_stepped_range_has_its_ends_and_equal_steps(low, step, n, short):
    """The end lies `short` thousandths of a step beyond the last value."""
    from dechirp.experiments.study.vary_values import stepped_values

    high = low + step * (n - 1) + step * short / 1000
    values = stepped_values(low, high, step)

    assert len(values) == n
    assert values[0] == low
    assert (values[-1] == high) == (short == 0)
    assert {b - a for a, b in pairwise(values)} == {step}


@settings(max_examples=60, deadline=None)
@given(low=st.floats(1e-6, 1e6), ratio=st.floats(1.01, 1e6), n=st.integers(2, 200))
def test_spaced_values_have_both_ends_and_equal_ratios(low, ratio, n):
    from dechirp.experiments.study.vary_values import spaced_values

    ends = Decimal(repr(low)), Decimal(repr(low * ratio))
    log_values = [float(value) for value in spaced_values(*ends, n, "log")]
    linear_values = [float(value) for value in spaced_values(*ends, n, "linear")]

    assert (
        (log_values[0], log_values[-1])
        == (linear_values[0], linear_values[-1])
        == tuple(map(float, ends))
    )
    # Values have twelve digits, of the number and of the larger end.
    expected = [low * (log_values[-1] / low) ** (k / (n - 1)) for k in range(n)]
    assert log_values == pytest.approx(expected, rel=1e-10)
    steps = [(b - a) * (n - 1) / (linear_values[-1] - low) for a, b in pairwise(linear_values)]
    assert steps == pytest.approx([1] * (n - 1), abs=1e-7 * n)


@settings(max_examples=60, deadline=None)
@given(st.decimals(allow_nan=False, allow_infinity=False, places=9))
def test_formatted_decimal_is_read_back(number):
    if abs(number) < Decimal("1e300"):
        assert parse_quantity(format_shortest_decimal(number), None) == float(number)


@pytest.mark.parametrize(
    ("path", "values", "labels"),
    [
        ("chain.cfar.estimator", "[{kind: cell-averaging}, {kind: ordered-statistic}]",
         ("cell-averaging", "ordered-statistic")),
        ("chain.angle", "[null, {kind: fft}]", ("none", "fft")),
        ("chain.angle", "[{kind: fft}, {kind: fft, window: hann}]", ("fft", "fft (window hann)")),
        ("impairments", "[[{kind: thermal-noise}], [{kind: thermal-noise}, {kind:"
                        " gas-attenuation}]]",
         ("thermal-noise", "thermal-noise + gas-attenuation")),
        ("impairments", "{clear: [{kind: thermal-noise}], none at all: []}",
         ("clear", "none at all")),
        ("scene.targets.car.position", "[[50 m, 0, 0], [60 m, 1 m, 0]]",
         ("50 m, 0, 0", "60 m, 1 m, 0")),
        ("chain.cfar.n_guard", "[{range: 1, velocity: 2}, {range: 3, velocity: 4}]",
         ("range 1, velocity 2", "range 3, velocity 4")),
    ],
)  # fmt: skip
def test_values_of_any_kind_have_short_labels(load_swept_setting, path, values, labels):
    axis = load_swept_setting(path, values)

    assert axis.labels == labels
    assert axis.numbers is None


def test_texts_of_values_are_valid_for_set_option(
    load_text, load_swept_setting, tmp_path, monkeypatch
):
    """Texts are valid from any working folder because file paths are absolute."""
    radar = "\n".join(line[2:] for line in SCENARIO.splitlines()[1:8])
    (tmp_path / "radar.yaml").write_text(radar)
    axes = [
        load_swept_setting("chain.angle", "[null, {kind: fft, window: hann}]"),
        load_swept_setting("radar", "{far: radar.yaml}", "name=x"),
        load_swept_setting("impairments", "{none: [], 'a: b': [{kind: thermal-noise}]}"),
    ]
    monkeypatch.chdir("/")

    for axis in axes:
        for text in axis.texts:
            set_study = load_text("scenario: scenario.yaml\nscores: [roc]\n", f"{axis.path}={text}")
            by_label = load_text("scenario: scenario.yaml\nscores: [roc]\n")
            assert (
                Plan.from_study(by_label).study.scenario != set_study.scenario
                or axis.path == "radar"
            )
            plan = Plan.from_study(
                Study(scenario=by_label.scenario, scores=by_label.scores, vary=(axis,))
            )
            assert plan.scenario_of_point(axis.texts.index(text)) == set_study.scenario


INVALID_CHANGES = [
    # old text, new text, setting, value, expected
    ("scenario.yaml", "senario.yaml", "scenario", "senario.yaml, which is no file", "the path"),
    ("scenario: scenario.yaml", "scenario: 7", "scenario", "7", "the path of a scenario file"),
    ("scenario: scenario.yaml\n", "", "scenario", "missing", "the path"),
    ("seed: 7", "seed: -7", "seed", "-7", "a whole number from 0"),
    ("seed: 7", "seed: 7.5", "seed", "7.5", "a whole number"),
    ("seed: 7", "sede: 7", "sede", "unknown setting", "name, scenario, seed"),
    ("seed: 7", "seed: 7\nseed: 8", "seed", "given twice, first on line 2", "one value"),
    ("seed: 7", "sensor: radar", "sensor", "radar", "one of signal, statistical"),
    ("seed: 7", "confidence: 1", "confidence", "1", "between 0 and 1"),
    ("seed: 7", "confidence: 95 %", "confidence", "95 %", "a bare number"),
    ("stop_after_failures: 0.01", "stop_after_failures: 1.5", "stop_after_failures", "1.5", "to 1"),
    # vary: paths
    ("car.rcs: {", "cra.rcs: {", "vary.scene.targets.cra", "not in the list", "one of car, truck"),
    ("car.rcs: {", "car.rsc: {", "vary.scene.targets.car.rsc", "unknown setting", "rcs"),
    ("chain.range", "chian.range", "vary.chian", "unknown setting", "chain"),
    ("chain.range_window:", "chain.range_window.x:", "vary.chain.range_window.x",
     "inside chain.range_window, which is one value", "inside a mapping"),
    ("chain.range_window: [hann, rectangular]", "seed: [1, 2]", "vary.seed", "varied",
     "other settings"),
    ("chain.range_window: [hann, rectangular]", "scene.targets.car: [{name: car, rcs: 0 dBsm}]",
     "vary.scene.targets.car", "combined with scene.targets.car.rcs", "settings of which"),
    ("chain.range_window: [hann, rectangular]", "scene.targets.0.rcs: [1 m^2]",
     "vary.scene.targets.0.rcs", "combined with scene.targets.car.rcs", "settings of which"),
    (f"  {RCS}\n", f"  {RCS}\n  {RCS}\n", "vary.scene.targets.car.rcs", "given twice",
     "one value"),
    (f"vary:\n  {RCS}\n  chain.range_window: [hann, rectangular]\n", "vary: [1]\n",
     "vary", "a list of 1", "a mapping of paths"),
    # vary: lists
    ("[hann, rectangular]", "hann", "vary.chain.range_window", "one value, hann", "a list"),
    ("[hann, rectangular]", "[]", "vary.chain.range_window", "an empty list", "a list"),
    ("[hann, rectangular]", "", "vary.chain.range_window", "null", "a list"),
    ("[hann, rectangular]", "{}", "vary.chain.range_window", "an empty mapping", "a list"),
    ("[hann, rectangular]", "[hann, hnan]", "vary.chain.range_window.1", "hnan", "one of"),
    ("[hann, rectangular]", "{a: hann, b: hnan}", "vary.chain.range_window.b", "hnan", "one of"),
    ("[hann, rectangular]", "[hann, hann]", "vary.chain.range_window.1", "once more", "differ"),
    ("[hann, rectangular]", "{from: 1, to: 2, n: 2}", "vary.chain.range_window", "a range",
     "a list: this setting takes one of"),
    ("[hann, rectangular]", "{uniform: [1, 2]}", "vary.chain.range_window", "a distribution",
     "a list"),
    ("chain.range_window: [hann, rectangular]", "chain.n_range_bins: [256, 100]",
     "vary.chain.n_range_bins", "100", ""),
    ("chain.range_window: [hann, rectangular]",
     "chain.cfar.estimator: [{kind: cell-averaging}, {kind: cell-averging}]",
     "vary.chain.cfar.estimator.1.kind", "cell-averging", "one of cell-averaging"),
    ("chain.range_window: [hann, rectangular]", "chain.cfar.estimator: {kind: cell-averaging}",
     "vary.chain.cfar.estimator", "one value, {kind: cell-averaging}", "a list"),
    ("chain.range_window: [hann, rectangular]", "scene.targets.truck.name: [truck, lorry]",
     "vary.scene.targets.truck.name", "lorry, with targets car, lorry", "the scenario's targets"),
    ("chain.range_window: [hann, rectangular]", "radar.frame.chirp.n_samples: [256, 512]",
     "vary.radar.frame.chirp.n_samples", "512, which makes radar.frame.chirp.ramp_duration", ""),
    # vary: ranges
    ("step: 5 dB}", "step: 0 dB}", "vary.scene.targets.car.rcs.step", "0 dB", "above 0"),
    ("step: 5 dB}", "step: -5 dB}", "vary.scene.targets.car.rcs.step", "-5 dB", "above 0"),
    ("step: 5 dB}", "step: 50 dB}", "vary.scene.targets.car.rcs.step", "50 dB", "at most 30 dB"),
    ("step: 5 dB}", "step: 5 dBsm}", "vary.scene.targets.car.rcs.step", "5 dBsm", "as 2 dB"),
    ("step: 5 dB}", "step: 5}", "vary.scene.targets.car.rcs.step", "5", "as 2 dB"),
    ("step: 5 dB}", "stpe: 5 dB}", "vary.scene.targets.car.rcs.stpe", "unknown setting", "step"),
    ("step: 5 dB}", "step: 1e-6 dB}", "vary.scene.targets.car.rcs.step", "30000001 values",
     "at most at_most_points, 100000"),
    ("step: 5 dB}", "n: 4, step: 1 dB}", "vary.scene.targets.car.rcs.step",
     "combined with n", "a step, or n"),
    (", step: 5 dB}", "}", "vary.scene.targets.car.rcs.step", "missing, and n", "a step, or n"),
    ("step: 5 dB}", "n: 0}", "vary.scene.targets.car.rcs.n", "0", "at least 2"),
    ("step: 5 dB}", "n: 2.5}", "vary.scene.targets.car.rcs.n", "2.5", "a whole number"),
    ("step: 5 dB}", "n: 1000000}", "vary.scene.targets.car.rcs.n", "1000000 values", "100000"),
    ("step: 5 dB}", "n: 4, spacing: log}", "vary.scene.targets.car.rcs.spacing", "log, of dBsm",
     "linear"),
    ("step: 5 dB}", "n: 4, spacing: lag}", "vary.scene.targets.car.rcs.spacing", "lag", "linear"),
    ("from: -10 dBsm", "from: 30 dBsm", "vary.scene.targets.car.rcs.from", "30 dBsm, with to at 20",
     "below to"),
    ("from: -10 dBsm", "from: 20 dBsm", "vary.scene.targets.car.rcs.from", "20 dBsm, with to at 20",
     "below to"),
    ("from: -10 dBsm", "from: -10 m", "vary.scene.targets.car.rcs.from", "-10 m", "as 10 dBsm"),
    ("from: -10 dBsm", "from: 0", "vary.scene.targets.car.rcs.from", "0", "a level in dBsm"),
    ("from: -10 dBsm, ", "", "vary.scene.targets.car.rcs.from", "missing", "the first value"),
    (RCS, "scene.targets.truck.position.0: {from: 0, to: 9 m, n: 3, spacing: log}",
     "vary.scene.targets.truck.position.0.from", "0 m", "above 0, where spacing is log"),
    (RCS, "scene.targets.truck.velocity.0: {from: 0 m/s, to: 1e9 m/s, n: 3}",
     "vary.scene.targets.truck.velocity.0", "which makes scene.targets.truck.velocity",
     "values for which"),
    (RCS, "radar.frame.n_chirps: {from: 8, to: 9, step: 0.5}", "vary.radar.frame.n_chirps.step",
     "no whole number", "whole"),
    (RCS, "radar.frame.n_chirps: {from: 8, to: 9, n: 5}", "vary.radar.frame.n_chirps.n",
     "5, more than there are whole numbers", "at most 2"),
    # vary: distributions
    (RCS, "scene.targets.car.position.0: {unifrom: [1 m, 2 m]}",
     "vary.scene.targets.car.position.0.unifrom", "unknown setting", "uniform"),
    (RCS, "scene.targets.car.position.0: {uniform: [2 m, 1 m]}",
     "vary.scene.targets.car.position.0.uniform.0", "2 m, with the upper end at 1 m", "below"),
    (RCS, "scene.targets.car.position.0: {uniform: [2 m]}",
     "vary.scene.targets.car.position.0.uniform", "a list of 1", "two numbers"),
    (RCS, "scene.targets.car.position.0: {normal: [2 m, -1 m]}",
     "vary.scene.targets.car.position.0.normal.1", "-1 m", "above 0"),
    (RCS, "scene.targets.car.position.0: {normal: [2 m, 1 m], uniform: [1 m, 2 m]}",
     "vary.scene.targets.car.position.0.uniform", "combined with normal", "one distribution"),
    (RCS, "scene.targets.car.rcs: {normal: [2 dBsm, 1 dBsm]}",
     "vary.scene.targets.car.rcs.normal.1", "1 dBsm", "as 2 dB"),
    (RCS, "scene.targets.car.rcs: {normal: [1 m^2, 1 m^2]}", "vary.scene.targets.car.rcs",
     "-2 m^2", "above 0"),
    (RCS, "radar.frame.n_chirps: {uniform: [8, 16]}", "vary.radar.frame.n_chirps.uniform",
     "drawn, of whole numbers", "a list or a range"),
    ("seed: 7", "draw: {method: sobol, n: 8}", "draw", "8 points", "a random setting"),
    ("seed: 7", "draw: {method: sobol, n: 100}", "draw.n", "100", "a power of two"),
    ("seed: 7", "draw: {method: sobol}", "draw.n", "missing", "a whole number"),
    ("seed: 7", "draw: {method: soblo, n: 8}", "draw.method", "soblo", "one of sobol"),
    # trials and scores
    ("at_most: 100,", "at_most: 0,", "trials.at_most", "0", "a whole number from 1"),
    ("at_most: 100,", "at_most: 100000000,", "trials.at_most", "makes 1400000000 at 14",
     "at most at_most_trials, 100000000"),
    ("at_most: 100,", "block: 0,", "trials.block", "0", "a whole number from 1"),
    ("width: 1e-3", "width: 0", "trials.until.width", "0", "above 0"),
    ("width: 1e-3", "width: 1 m", "trials.until.width", "1 m", "a bare number"),
    ("score: false_alarm_probability, width", "score: false_alram, width", "trials.until.score",
     "false_alram", "one of the study's scores"),
    ("width: 1e-3", "width: 1e-3, target: cra", "trials.until.target", "cra", "car, truck"),
    ("track_ospa]", "trak_ospa]",
     "scores.1", "trak_ospa", "track_ospa"),
    ("scores: [false_alarm_probability, track_ospa]",
     "scores: [false_alarm_probability, {kind: track_ospa, cut: 3 m}]", "scores.1.cut",
     "unknown setting", "cutoff"),
    ("track_ospa]", "track_ospa, track_ospa]", "scores", "track_ospa twice", "each once"),
    ("scores: [false_alarm_probability, track_ospa]\n", "scores: []\n", "scores", "an empty list",
     "a list of scores"),
    ("scores: [false_alarm_probability, track_ospa]\n", "", "scores", "missing", "a list"),
    # require
    ("at_most: 10 cm,", "at_most: 10 s,", "require.1.at_most", "10 s", "a length"),
    ("at_most: 10 cm,", "", "require.1.at_least", "missing, and at_most", "a limit"),
    ("at_most: 10 cm,", "at_most: 10 cm, at_least: 1 m,", "require.1.at_least", "1 m", "no more"),
    ("at_most: 10 cm,", "at_most: 10 cm, target: cra,", "require.1.target", "cra", "car, truck"),
    ("confidence: 0.9}", "confidence: 2}", "require.1.confidence", "2", "between 0 and 1"),
    ("score: track_ospa, at_most", "score: track_opsa, at_most", "require.1.score", "track_opsa",
     "one of the study's scores: false_alarm_probability, track_ospa"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: {scene.targets.car.rcs: 11 dBsm}",
     "require.0.points.scene.targets.car.rcs", "scene.targets.car.rcs: 11 dBsm", "-10 dBsm, -5"
                                                                                 " dBsm"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: {scene.targets.truck.rcs: 11 dBsm}",
     "require.0.points.scene.targets.truck.rcs", "not a swept setting", "scene.targets.car.rcs"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: 10 dBsm", "require.0.points", "10 dBsm",
     "a mapping of paths"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old_text", "new_text", "setting", "value", "expected"),
    INVALID_CHANGES,
    ids=[f"{w[1]!r:.60}" for w in INVALID_CHANGES],
)
def test_mistake_is_reported_with_setting_line_and_expected_value(
    load_text, old_text, new_text, setting, value, expected
):
    assert old_text in STUDY
    text = STUDY.replace(old_text, new_text, 1)
    mistakes = collect_mistakes(load_text, text)

    matching = [mistake for mistake in mistakes if mistake.setting == setting]
    assert matching, mistakes
    assert value in matching[0].value
    assert expected in matching[0].expected
    assert matching[0].file.endswith("study.yaml")
    if new_text:
        assert text.splitlines()[matching[0].line - 1] not in STUDY.splitlines() or value in (
            "missing",
            "given twice",
        )
    # No mistake is repeated, and none is reported that only follows from another one.
    dependent_keys = {"at_least", "points"} if "vary" in setting or "scores" in setting else set()
    other_keys = {
        mistake.setting.split(".")[2]
        for mistake in mistakes
        if mistake.setting.startswith("require")
    }
    assert len(mistakes) == 1 or other_keys <= dependent_keys or setting.startswith("require"), (
        mistakes
    )


def test_all_mistakes_are_reported_in_file_order(load_text):
    text = STUDY.replace("seed: 7", "seed: x").replace("step: 5 dB", "step: 0 dB")
    text = text.replace("[hann,", "[hnan,").replace("width: 1e-3", "width: 1 m")
    text = text.replace("10 cm", "10 dB")
    scenario = SCENARIO.replace("n_chirps: 32", "n_chirps: 3.2")

    assert [mistake.setting for mistake in collect_mistakes(load_text, text)] == [
        "seed",
        "vary.scene.targets.car.rcs.step",
        "vary.chain.range_window.0",
        "trials.until.width",
        "require.1.at_most",
    ]
    settings = {
        mistake.setting: mistake.file
        for mistake in collect_mistakes(load_text, text, scenario=scenario)
    }
    assert settings["radar.frame.n_chirps"].endswith("scenario.yaml")
    assert settings["seed"].endswith("study.yaml")
    assert not any(setting.startswith("vary") for setting in settings)


def test_rejects_recording_as_scenario_of_study(load_text):
    (mistake,) = collect_mistakes(load_text, STUDY, scenario="recording: {path: x.npy}\n")

    assert (mistake.setting, mistake.value) == ("scenario", "of a recording")
    assert "tune" in mistake.fix


def test_scenario_can_be_written_inside_study_file(load_text):
    inline_scenario = "scenario:\n" + "".join(f"  {line}\n" for line in SCENARIO.splitlines())

    assert load_text(STUDY.replace("scenario: scenario.yaml\n", inline_scenario)) == load_text(
        STUDY
    )
    invalid_scenario = inline_scenario.replace("n_chirps: 32", "n_chirps: 3.2")
    (mistake,) = collect_mistakes(
        load_text, STUDY.replace("scenario: scenario.yaml\n", invalid_scenario)
    )
    assert (mistake.setting, mistake.line) == ("radar.frame.n_chirps", 6)


def test_grid_beyond_limit_must_be_confirmed(load_text):
    text = STUDY.replace("[hann, rectangular]", "[hann, rectangular]\n  scene.targets.truck."
                         "position.0: {from: 1 m, to: 8 km, step: 1 m}").replace(
        "at_most: 100,", "at_most: 10,")  # fmt: skip
    (mistake,) = collect_mistakes(load_text, text)

    assert (mistake.setting, mistake.value) == ("vary", "a grid of 112000 points")
    assert "at_most_points: 112000" in mistake.fix
    study = load_text(f"{text}at_most_points: 112000\n")
    plan = Plan.from_study(study)
    assert plan.n_points == 112_000
    assert dict(plan.setting_texts_of_point(111_999)) == {
        "scene.targets.car.rcs": "20 dBsm",
        "chain.range_window": "rectangular",
        "scene.targets.truck.position.0": "8000 m",
    }


def test_set_options_apply_to_scenario_or_study(load_text):
    study = load_text(
        STUDY,
        "n_frames=3",
        "scenario.name=other",
        "seed=3",
        "trials.at_most=200",
        "require.0.at_most=0.01",
        "vary.radar.frame.n_chirps=[16, 32]",
        seed=11,
    )

    assert (study.scenario.n_frames, study.scenario.name, study.scenario.seed) == (3, "other", 3)
    assert (study.trials.at_most, study.require[0].at_most, study.seed) == (200, 0.01, 11)
    assert study.vary[2].texts == ("16", "32")
    assert study.trials.until == load_text(STUDY).trials.until


def test_set_option_fixes_varied_setting(load_text):
    text = STUDY.replace("[hann, rectangular]", "{soft: hann, hard: rectangular}")
    study = load_text(text, "scene.targets.car.rcs=3 dBsm", "chain.range_window=hard")

    assert study.n_points == 1
    assert Plan.from_study(study).setting_texts_of_point(0) == (
        ("scene.targets.car.rcs", "3 dBsm"),
        ("chain.range_window", "rectangular"),
    )
    # The other requirement has no points.
    assert [requirement.score for requirement in study.require] == ["track_ospa"]


@pytest.mark.parametrize(
    ("option", "setting", "value"),
    [
        ("scene.targets.car.rcs=3 m", "scene.targets.car.rcs", "3 m"),
        ("scene.targets.0.rcs=3 m^2", "scene.targets.0.rcs", "combined with scene"),
        ("radar.frame.n_chips=3", "radar.frame.n_chips", "unknown setting"),
        ("trials.atmost=3", "trials.atmost", "unknown setting"),
        ("vary.chain.rng=[3]", "vary.chain.rng", "unknown setting"),
        ("n_frames", "--set", "n_frames"),
    ],
)
def test_invalid_set_option_is_reported_as_option(load_text, option, setting, value):
    mistakes = collect_mistakes(load_text, STUDY, option)

    matching = [mistake for mistake in mistakes if setting in mistake.setting]
    assert len(mistakes) == 1 and matching, mistakes
    assert matching[0].file == "--set"
    assert value in matching[0].value


def test_values_of_requirement_are_quantities(load_text):
    for text in ("10 dBsm", "10.0 dBsm", "10 m^2", "1e5 cm^2"):
        study = load_text(STUDY.replace("10.0 dBsm", text))
        assert study.require[0].points == (("scene.targets.car.rcs", "10 dBsm"),)


def test_study_built_in_python_is_checked(load_text):
    study = load_text(STUDY)
    settings = {"scenario": study.scenario, "scores": study.scores}
    axis = SweptSetting(path="n_frames", texts=("1",))

    with pytest.raises(InvalidSetting, match="n_frames twice"):
        Study(**settings, vary=(axis, axis))
    with pytest.raises(InvalidSetting, match="SweptSetting.labels: 2 of them"):
        SweptSetting(path="n_frames", texts=("1",), labels=("a", "b"))
    with pytest.raises(InvalidSetting, match="1 twice"):
        SweptSetting(path="n_frames", texts=("1", "1"))
    with pytest.raises(InvalidSetting, match="power of two"):
        Sampling(n=3)
    with pytest.raises(InvalidSetting, match="above the lower end"):
        RandomSetting(path="x", distribution="uniform", first=1.0, second=math.nan)
    with pytest.raises(InvalidSetting, match="nfames: unknown setting"):
        Plan.from_study(Study(**settings, vary=(SweptSetting(path="nfames", texts=("1",)),)))
