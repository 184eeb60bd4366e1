"""Study files: what they vary, and what is told of those that cannot be meant."""

import math
from decimal import Decimal
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dechirp.config.quantities import format_decimal, parse_quantity
from dechirp.core.errors import InvalidFile, InvalidSetting
from dechirp.experiments.study.dumping import dump_study
from dechirp.experiments.study.parsing import load_study
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.study import RandomSetting, Sampling, Study, SweptSetting

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
def load(tmp_path):
    """Read a text as a study file, beside the scenario."""

    def loaded(text, *overrides, scenario=SCENARIO, **more):
        (tmp_path / "scenario.yaml").write_text(scenario)
        (tmp_path / "study.yaml").write_text(text)
        return load_study(tmp_path / "study.yaml", overrides, **more)

    return loaded


@pytest.fixture
def varied(load):
    """One setting of a study that varies nothing else."""

    def made(path, said, *overrides, more=""):
        text = f"scenario: scenario.yaml\nscores: [processing_time]\n{more}vary: {{{path}: {said}}}"
        return load(text, *overrides).vary[0]

    return made


def told(loaded, *args, **more):
    """All that is wrong with a file."""
    with pytest.raises(InvalidFile) as error:
        loaded(*args, **more)
    for mistake in error.value.mistakes:
        assert mistake.setting and mistake.value and mistake.expected and mistake.fix
        assert mistake.file
    return error.value.mistakes


def test_a_study_reads_as_it_is_written(load):
    study = load(STUDY)

    rcs, window = study.vary
    assert rcs.texts == tuple(f"{level} dBsm" for level in range(-10, 25, 5))
    assert (rcs.numbers, rcs.unit) == (tuple(range(-10, 25, 5)), "dBsm")
    assert (window.texts, window.numbers, window.unit) == (("hann", "rectangular"), None, "")
    assert (study.seed, study.n_points) == (7, 14)
    assert study.trials.until.width == 1e-3
    first, second = study.require
    assert first.points == (("scene.targets.car.rcs", "10 dBsm"),)  # the text of the list
    assert (second.at_most, second.confidence) == (0.1, 0.9)


def test_a_study_is_written_so_that_it_is_read_back_equal(load):
    more = "  scene.targets.truck.position.0: {normal: [90 m, 10 cm]}\n"
    more += "  radar.hardware.noise_factor: {uniform: [10 dB, 14 dB]}\n"
    more += "  impairments: {clear: [{kind: thermal-noise}], 'to: be': []}\n"
    more += "  chain.angle: [null, {kind: fft}]\ndraw: {method: sobol, n: 8}\n"
    study = load(STUDY.replace("trials:", more + "trials:", 1))

    text = dump_study(study)
    assert load(text) == study
    assert dump_study(load(text)) == text


def test_a_long_range_stays_short_where_it_is_written(load):
    said = "{from: 1 m, to: 200 m, n: 300, spacing: log}"
    study = load(
        "scenario: scenario.yaml\nscores: [processing_time]\ntrials: {at_most: 10}\n"
        f"vary: {{scene.targets.car.position.0: {said}}}"
    )

    text = dump_study(study)
    assert said in text
    assert load(text) == study


@pytest.mark.parametrize(
    ("said", "texts"),
    [
        ("{from: -45 dB, to: -10 dB, step: 2.5 dB}", [f"{-45 + 2.5 * k:g} dB" for k in range(15)]),
        ("{from: 0 dB, to: 1 dB, step: 0.4 dB}", ["0 dB", "0.4 dB", "0.8 dB"]),
        ("{from: 1, to: 2, step: 0.5}", ["1", "1.5", "2"]),
        ("{from: 1, to: 100, n: 3, spacing: log}", ["1", "10", "100"]),
        ("{from: 1, to: 10 dB, n: 3}", ["0 dB", "5 dB", "10 dB"]),
        ("[1, 3 dB]", ["1", "3 dB"]),
    ],
)
def test_ranges_of_ratios_are_what_people_mean(varied, said, texts):
    assert list(varied("impairments.white-noise.snr", said).texts) == texts


@pytest.mark.parametrize(
    ("said", "texts"),
    [
        ("{from: 10 cm, to: 0.5 m, step: 20 cm}", ["10 cm", "30 cm", "50 cm"]),
        ("{from: 0, to: 1 km, step: 500 m}", ["0 km", "0.5 km", "1 km"]),
        ("{from: 1 m, to: 100 m, n: 3, spacing: log}", ["1 m", "10 m", "100 m"]),
        ("{from: -1 m, to: 2 m, n: 4}", ["-1 m", "0 m", "1 m", "2 m"]),
        ("{from: 0.1 m, to: 0.7 m, step: 0.1 m}", [f"0.{k} m" for k in range(1, 8)]),
    ],
)
def test_ranges_of_lengths_take_units_that_fit(varied, said, texts):
    axis = varied("scene.targets.truck.position.0", said)

    assert list(axis.texts) == texts
    assert axis.numbers == tuple(float(text.split()[0]) for text in texts)
    assert axis.unit == texts[0].split()[1]


def test_numbers_of_a_list_are_in_its_first_unit(varied):
    axis = varied("scene.targets.car.rcs", "[0.1 m^2, 10 dBsm, 1e6 cm2]")

    assert axis.unit == "m^2"
    assert axis.numbers == pytest.approx((0.1, 10, 100), rel=1e-12)


def test_counts_stay_whole_in_equal_ratios(varied):
    axis = varied("radar.frame.n_chirps", "{from: 16, to: 256, n: 5, spacing: log}")

    assert axis.texts == ("16", "32", "64", "128", "256")


@settings(max_examples=60, deadline=None)
@given(
    low=st.decimals(-1000, 1000, places=3),
    step=st.decimals(Decimal("0.001"), 100, places=3),
    n=st.integers(2, 300),
    short=st.integers(0, 999),
)
def test_a_range_has_its_ends_and_equal_steps(low, step, n, short):
    """`short`: thousandths of a step by which the end is beyond the last value."""
    from dechirp.experiments.study.vary_values import stepped_values

    high = low + step * (n - 1) + step * short / 1000
    made = stepped_values(low, high, step)

    assert len(made) == n
    assert made[0] == low
    assert (made[-1] == high) == (short == 0)
    assert {b - a for a, b in pairwise(made)} == {step}


@settings(max_examples=60, deadline=None)
@given(low=st.floats(1e-6, 1e6), ratio=st.floats(1.01, 1e6), n=st.integers(2, 200))
def test_equal_ratios_have_both_ends(low, ratio, n):
    from dechirp.experiments.study.vary_values import spaced_values

    ends = Decimal(repr(low)), Decimal(repr(low * ratio))
    made = [float(one) for one in spaced_values(*ends, n, "log")]
    even = [float(one) for one in spaced_values(*ends, n, "linear")]

    assert (made[0], made[-1]) == (even[0], even[-1]) == tuple(map(float, ends))
    # Twelve digits are kept, of the number and of the larger end.
    expected = [low * (made[-1] / low) ** (k / (n - 1)) for k in range(n)]
    assert made == pytest.approx(expected, rel=1e-10)
    steps = [(b - a) * (n - 1) / (even[-1] - low) for a, b in pairwise(even)]
    assert steps == pytest.approx([1] * (n - 1), abs=1e-7 * n)


@settings(max_examples=60, deadline=None)
@given(st.decimals(allow_nan=False, allow_infinity=False, places=9))
def test_digits_of_a_number_are_read_back(number):
    if abs(number) < Decimal("1e300"):
        assert parse_quantity(format_decimal(number), None) == float(number)


@pytest.mark.parametrize(
    ("path", "said", "labels"),
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
def test_values_of_any_kind_have_short_labels(varied, path, said, labels):
    axis = varied(path, said)

    assert axis.labels == labels
    assert axis.numbers is None


def test_texts_of_values_do_for_set(load, varied, tmp_path, monkeypatch):
    """From everywhere: files have absolute paths."""
    radar = "\n".join(line[2:] for line in SCENARIO.splitlines()[1:8])
    (tmp_path / "radar.yaml").write_text(radar)
    axes = [
        varied("chain.angle", "[null, {kind: fft, window: hann}]"),
        varied("radar", "{far: radar.yaml}", "name=x"),
        varied("impairments", "{none: [], 'a: b': [{kind: thermal-noise}]}"),
    ]
    monkeypatch.chdir("/")

    for axis in axes:
        for text in axis.texts:
            again = load("scenario: scenario.yaml\nscores: [roc]\n", f"{axis.path}={text}")
            by_label = load("scenario: scenario.yaml\nscores: [roc]\n")
            assert (
                Plan.from_study(by_label).study.scenario != again.scenario or axis.path == "radar"
            )
            both = Plan.from_study(
                Study(scenario=by_label.scenario, scores=by_label.scores, vary=(axis,))
            )
            assert both.scenario(axis.texts.index(text)) == again.scenario


WRONG = [
    # what stands there, what stands there then, setting, got, need
    ("scenario.yaml", "senario.yaml", "scenario", "senario.yaml, which is no file", "the path"),
    ("scenario: scenario.yaml", "scenario: 7", "scenario", "7", "the path of a scenario file"),
    ("scenario: scenario.yaml\n", "", "scenario", "missing", "given: the path"),
    ("seed: 7", "seed: -7", "seed", "-7", "a whole number from 0"),
    ("seed: 7", "seed: 7.5", "seed", "7.5", "a whole number"),
    ("seed: 7", "sede: 7", "sede", "not a known name", "name, scenario, seed"),
    ("seed: 7", "seed: 7\nseed: 8", "seed", "given twice, first on line 2", "given once"),
    ("seed: 7", "sensor: radar", "sensor", "radar", "one of signal, statistical"),
    ("seed: 7", "confidence: 1", "confidence", "1", "between 0 and 1"),
    ("seed: 7", "confidence: 95 %", "confidence", "95 %", "a bare number"),
    ("stop_after_failures: 0.01", "stop_after_failures: 1.5", "stop_after_failures", "1.5", "to 1"),
    # vary: where
    ("car.rcs: {", "cra.rcs: {", "vary.scene.targets.cra", "not in the list", "one of car, truck"),
    ("car.rcs: {", "car.rsc: {", "vary.scene.targets.car.rsc", "not a known name", "rcs"),
    ("chain.range", "chian.range", "vary.chian", "not a known name", "chain"),
    ("chain.range_window:", "chain.range_window.x:", "vary.chain.range_window.x",
     "inside chain.range_window, which is one value", "inside a mapping"),
    ("chain.range_window: [hann, rectangular]", "seed: [1, 2]", "vary.seed", "varied", "left out"),
    ("chain.range_window: [hann, rectangular]", "scene.targets.car: [{name: car, rcs: 0 dBsm}]",
     "vary.scene.targets.car", "beside scene.targets.car.rcs", "apart"),
    ("chain.range_window: [hann, rectangular]", "scene.targets.0.rcs: [1 m^2]",
     "vary.scene.targets.0.rcs", "beside scene.targets.car.rcs", "apart"),
    (f"  {RCS}\n", f"  {RCS}\n  {RCS}\n", "vary.scene.targets.car.rcs", "given twice",
     "given once"),
    (f"vary:\n  {RCS}\n  chain.range_window: [hann, rectangular]\n", "vary: [1]\n",
     "vary", "a list of 1", "a mapping of paths"),
    # vary: lists
    ("[hann, rectangular]", "hann", "vary.chain.range_window", "one value, hann", "a list"),
    ("[hann, rectangular]", "[]", "vary.chain.range_window", "an empty list", "a list"),
    ("[hann, rectangular]", "", "vary.chain.range_window", "null", "a list"),
    ("[hann, rectangular]", "{}", "vary.chain.range_window", "an empty mapping", "a list"),
    ("[hann, rectangular]", "[hann, hnan]", "vary.chain.range_window.1", "hnan", "one of"),
    ("[hann, rectangular]", "{a: hann, b: hnan}", "vary.chain.range_window.b", "hnan", "one of"),
    ("[hann, rectangular]", "[hann, hann]", "vary.chain.range_window.1", "once more", "its own"),
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
    ("step: 5 dB}", "stpe: 5 dB}", "vary.scene.targets.car.rcs.stpe", "not a known", "step"),
    ("step: 5 dB}", "step: 1e-6 dB}", "vary.scene.targets.car.rcs.step", "30000001 values",
     "at most at_most_points, 100000"),
    ("step: 5 dB}", "n: 4, step: 1 dB}", "vary.scene.targets.car.rcs.step", "beside n", "one of"),
    (", step: 5 dB}", "}", "vary.scene.targets.car.rcs.step", "missing, and n", "one of the two"),
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
    ("from: -10 dBsm, ", "", "vary.scene.targets.car.rcs.from", "missing", "given"),
    (RCS, "scene.targets.truck.position.0: {from: 0, to: 9 m, n: 3, spacing: log}",
     "vary.scene.targets.truck.position.0.from", "0 m", "above 0, where spacing is log"),
    (RCS, "scene.targets.truck.velocity.0: {from: 0 m/s, to: 1e9 m/s, n: 3}",
     "vary.scene.targets.truck.velocity.0", "which makes scene.targets.truck.velocity",
     "such that"),
    (RCS, "radar.frame.n_chirps: {from: 8, to: 9, step: 0.5}", "vary.radar.frame.n_chirps.step",
     "no whole number", "whole"),
    (RCS, "radar.frame.n_chirps: {from: 8, to: 9, n: 5}", "vary.radar.frame.n_chirps.n",
     "5, more than there are whole numbers", "at most 2"),
    # vary: distributions
    (RCS, "scene.targets.car.position.0: {unifrom: [1 m, 2 m]}",
     "vary.scene.targets.car.position.0.unifrom", "not a known name", "uniform"),
    (RCS, "scene.targets.car.position.0: {uniform: [2 m, 1 m]}",
     "vary.scene.targets.car.position.0.uniform.0", "2 m, with the upper end at 1 m", "below"),
    (RCS, "scene.targets.car.position.0: {uniform: [2 m]}",
     "vary.scene.targets.car.position.0.uniform", "a list of 1", "two numbers"),
    (RCS, "scene.targets.car.position.0: {normal: [2 m, -1 m]}",
     "vary.scene.targets.car.position.0.normal.1", "-1 m", "above 0"),
    (RCS, "scene.targets.car.position.0: {normal: [2 m, 1 m], uniform: [1 m, 2 m]}",
     "vary.scene.targets.car.position.0.uniform", "beside normal", "alone"),
    (RCS, "scene.targets.car.rcs: {normal: [2 dBsm, 1 dBsm]}",
     "vary.scene.targets.car.rcs.normal.1", "1 dBsm", "as 2 dB"),
    (RCS, "scene.targets.car.rcs: {normal: [1 m^2, 1 m^2]}", "vary.scene.targets.car.rcs",
     "-2 m^2", "above 0"),
    (RCS, "radar.frame.n_chirps: {uniform: [8, 16]}", "vary.radar.frame.n_chirps.uniform",
     "drawn, of whole numbers", "a list or a range"),
    ("seed: 7", "draw: {method: sobol, n: 8}", "draw", "nothing to draw", "left out"),
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
     "not a known name", "cutoff"),
    ("track_ospa]", "track_ospa, track-ospa]", "scores", "track_ospa twice", "each once"),
    ("scores: [false_alarm_probability, track_ospa]\n", "scores: []\n", "scores", "an empty list",
     "a list of scores"),
    ("scores: [false_alarm_probability, track_ospa]\n", "", "scores", "missing", "a list"),
    # require
    ("at_most: 10 cm,", "at_most: 10 s,", "require.1.at_most", "10 s", "a length"),
    ("at_most: 10 cm,", "", "require.1.at_least", "absent, and no at_most", "a limit"),
    ("at_most: 10 cm,", "at_most: 10 cm, at_least: 1 m,", "require.1.at_least", "1 m", "no more"),
    ("at_most: 10 cm,", "at_most: 10 cm, target: cra,", "require.1.target", "cra", "car, truck"),
    ("confidence: 0.9}", "confidence: 2}", "require.1.confidence", "2", "between 0 and 1"),
    ("score: track_ospa, at_most", "score: track_opsa, at_most", "require.1.score", "track_opsa",
     "one of the study's scores: false_alarm_probability, track_ospa"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: {scene.targets.car.rcs: 11 dBsm}",
     "require.0.points.scene.targets.car.rcs", "scene.targets.car.rcs: 11 dBsm", "-10 dBsm, -5"
                                                                                 " dBsm"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: {scene.targets.truck.rcs: 11 dBsm}",
     "require.0.points.scene.targets.truck.rcs", "which takes no values", "scene.targets.car.rcs"),
    ("points: {scene.targets.car.rcs: 10.0 dBsm}", "points: 10 dBsm", "require.0.points", "10 dBsm",
     "a mapping of paths"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("was", "becomes", "setting", "value", "expected"), WRONG, ids=[f"{w[1]!r:.60}" for w in WRONG]
)
def test_what_is_wrong_is_told_with_its_place(load, was, becomes, setting, value, expected):
    assert was in STUDY
    text = STUDY.replace(was, becomes, 1)
    mistakes = told(load, text)

    found = [one for one in mistakes if one.setting == setting]
    assert found, mistakes
    assert value in found[0].value
    assert expected in found[0].expected
    assert found[0].file.endswith("study.yaml")
    if becomes:
        assert text.splitlines()[found[0].line - 1] not in STUDY.splitlines() or value in (
            "missing",
            "given twice",
        )
    # Nothing is told twice, and nothing that follows only from another mistake.
    follows = {"at_least", "points"} if "vary" in setting or "scores" in setting else set()
    others = {one.setting.split(".")[2] for one in mistakes if one.setting.startswith("require")}
    assert len(mistakes) == 1 or others <= follows or setting.startswith("require"), mistakes


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(load):
    text = STUDY.replace("seed: 7", "seed: x").replace("step: 5 dB", "step: 0 dB")
    text = text.replace("[hann,", "[hnan,").replace("width: 1e-3", "width: 1 m")
    text = text.replace("10 cm", "10 dB")
    scenario = SCENARIO.replace("n_chirps: 32", "n_chirps: 3.2")

    assert [one.setting for one in told(load, text)] == [
        "seed",
        "vary.scene.targets.car.rcs.step",
        "vary.chain.range_window.0",
        "trials.until.width",
        "require.1.at_most",
    ]
    settings = {one.setting: one.file for one in told(load, text, scenario=scenario)}
    assert settings["radar.frame.n_chirps"].endswith("scenario.yaml")
    assert settings["seed"].endswith("study.yaml")
    assert not any(setting.startswith("vary") for setting in settings)


def test_a_recording_is_no_scenario_of_a_study(load):
    (one,) = told(load, STUDY, scenario="recording: {path: x.npy}\n")

    assert (one.setting, one.value) == ("scenario", "of a recording")
    assert "tune" in one.fix


def test_a_scenario_may_stand_in_the_file_itself(load):
    inside = "scenario:\n" + "".join(f"  {line}\n" for line in SCENARIO.splitlines())

    assert load(STUDY.replace("scenario: scenario.yaml\n", inside)) == load(STUDY)
    wrong = inside.replace("n_chirps: 32", "n_chirps: 3.2")
    (one,) = told(load, STUDY.replace("scenario: scenario.yaml\n", wrong))
    assert (one.setting, one.line) == ("radar.frame.n_chirps", 6)


def test_a_grid_beyond_what_is_stated_must_be_confirmed(load):
    text = STUDY.replace("[hann, rectangular]", "[hann, rectangular]\n  scene.targets.truck."
                         "position.0: {from: 1 m, to: 8 km, step: 1 m}").replace(
        "at_most: 100,", "at_most: 10,")  # fmt: skip
    (one,) = told(load, text)

    assert (one.setting, one.value) == ("vary", "a grid of 112000 points")
    assert "at_most_points: 112000" in one.fix
    study = load(f"{text}at_most_points: 112000\n")
    plan = Plan.from_study(study)
    assert plan.n_points == 112_000
    assert dict(plan.point_settings(111_999)) == {
        "scene.targets.car.rcs": "20 dBsm",
        "chain.range_window": "rectangular",
        "scene.targets.truck.position.0": "8000 m",
    }


def test_options_go_to_the_scenario_or_to_the_study(load):
    study = load(
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
    assert study.trials.until == load(STUDY).trials.until


def test_a_varied_setting_that_is_set_keeps_one_value(load):
    text = STUDY.replace("[hann, rectangular]", "{soft: hann, hard: rectangular}")
    study = load(text, "scene.targets.car.rcs=3 dBsm", "chain.range_window=hard")

    assert study.n_points == 1
    assert Plan.from_study(study).point_settings(0) == (
        ("scene.targets.car.rcs", "3 dBsm"),
        ("chain.range_window", "rectangular"),
    )
    assert [one.score for one in study.require] == ["track_ospa"]  # the other has no points left


@pytest.mark.parametrize(
    ("option", "setting", "value"),
    [
        ("scene.targets.car.rcs=3 m", "scene.targets.car.rcs", "3 m"),
        ("scene.targets.0.rcs=3 m^2", "scene.targets.0.rcs", "beside scene.targets.car.rcs"),
        ("radar.frame.n_chips=3", "radar.frame.n_chips", "not a known name"),
        ("trials.atmost=3", "trials.atmost", "not a known name"),
        ("vary.chain.rng=[3]", "vary.chain.rng", "not a known name"),
        ("n_frames", "--set", "n_frames"),
    ],
)
def test_an_option_that_cannot_be_is_told_as_one(load, option, setting, value):
    mistakes = told(load, STUDY, option)

    found = [one for one in mistakes if setting in one.setting]
    assert len(mistakes) == 1 and found, mistakes
    assert found[0].file == "--set"
    assert value in found[0].value


def test_values_of_a_requirement_are_quantities(load):
    for text in ("10 dBsm", "10.0 dBsm", "10 m^2", "1e5 cm^2"):
        study = load(STUDY.replace("10.0 dBsm", text))
        assert study.require[0].points == (("scene.targets.car.rcs", "10 dBsm"),)


def test_a_limit_holds_however_its_score_is_spelt(load):
    hyphens = STUDY.replace("score: false_alarm_probability", "score: false-alarm-probability")
    assert hyphens != STUDY

    assert load(hyphens).require == load(STUDY).require


def test_a_study_made_in_python_is_checked_as_well(load):
    study = load(STUDY)
    made = {"scenario": study.scenario, "scores": study.scores}
    twice = SweptSetting(path="n_frames", texts=("1",))

    with pytest.raises(InvalidSetting, match="n_frames twice"):
        Study(**made, vary=(twice, twice))
    with pytest.raises(InvalidSetting, match="SweptSetting.labels: 2 of them"):
        SweptSetting(path="n_frames", texts=("1",), labels=("a", "b"))
    with pytest.raises(InvalidSetting, match="1 twice"):
        SweptSetting(path="n_frames", texts=("1", "1"))
    with pytest.raises(InvalidSetting, match="power of two"):
        Sampling(n=3)
    with pytest.raises(InvalidSetting, match="above the lower end"):
        RandomSetting(path="x", distribution="uniform", first=1.0, second=math.nan)
    with pytest.raises(InvalidSetting, match="nfames: not a known name"):
        Plan.from_study(Study(**made, vary=(SweptSetting(path="nfames", texts=("1",)),)))
