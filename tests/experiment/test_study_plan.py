"""Plan of a study: scenarios of points and trials, random settings and digests."""

import pickle
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from dechirp.config import loading
from dechirp.config.dumping import dump_node_on_one_line, dump_yaml
from dechirp.config.setting_paths import (
    build_value_with_replaced_setting,
    find_setting,
    replace_settings,
)
from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.scenario import READERS, Scenario
from dechirp.experiments.study.plan import Plan, describe_identity_changes
from dechirp.experiments.study.study import RandomSetting, Sampling, Study, SweptSetting
from dechirp.experiments.study.variants import ABSOLUTE_CONTEXT, ScenarioVariants
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.scene.bodies.base import Body
from dechirp.simulation.impairments.base import Impairment
from dechirp.theory.confidence_intervals import binomial_interval
from nightly import nightly, nightly_except

RICH = """\
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 3 us, ramp_duration: 29 us,
            sample_rate: 10 MHz, n_samples: 256, sampling: complex}
    n_chirps: 32
    interval: 35 us
    period: 50 ms
    multiplexing: {kind: tdm, order: [0, 1]}
  array:
    tx: [[0 mm, 0 mm, 0 mm], [0 mm, 7.776 mm, 0 mm]]
    rx: [[0 mm, 0 mm, 0 mm], [0 mm, 1.944 mm, 0 mm], [0 mm, 3.888 mm, 0 mm], [0 mm, 5.832 mm, 0]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB, loss: 1 dB,
             tx_pattern: {kind: cosine, azimuth_beamwidth: 60 deg, elevation_beamwidth: 20 deg}}
scene:
  ego: {velocity: [10 m/s, 0 m/s, 0 m/s]}
  targets:
    - {name: car, position: [60 m, 3 m, 0 m], velocity: [8 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}
    - {name: truck, position: [90 m, -4 m, 0 m], rcs: 20 dBsm, fluctuation: swerling-1}
    - {name: van, position: [30 m, -4 m, 0 m], body: {kind: van}}
impairments: [{kind: thermal-noise}, {kind: rain-attenuation, rate: 4 mm/h}, {kind: leakage,
isolation: 30 dB}]
chain:
  n_range_bins: 256
  mitigation: []
  angle: {kind: fft}
  cluster: {min_detections: 2}
n_frames: 3
"""


@pytest.fixture(scope="module")
def rich_scenario():
    """Return a scenario with values for most of its settings."""
    return loading.parse_settings(RICH, Scenario, readers=READERS)


@pytest.fixture(scope="module")
def one_target_scenario(rich_scenario):
    """Return the rich scenario with one simple target, which is checked faster."""
    return replace(
        rich_scenario, scene=replace(rich_scenario.scene, targets=rich_scenario.scene.targets[:1])
    )


def set_by_text(settings_value, *options):
    """Change settings as `--set` does, by dumping and parsing the text."""
    return loading.parse_settings(
        dump_yaml(settings_value), type(settings_value), overrides=options, readers=READERS
    )


def set_by_value(settings_value, path, text):
    """Change a setting directly, without an intermediate text."""
    setting_path = find_setting(settings_value, path)
    return replace_settings(
        settings_value,
        {
            setting_path.steps: build_value_with_replaced_setting(
                settings_value, setting_path, parse_yaml(text, ""), ABSOLUTE_CONTEXT
            )
        },
    )


def iter_leaves(node, path=""):
    """Yield path and node of each scalar."""
    children = list(node.iter_children())
    if not children:
        yield path, node
    for label, child in children:
        yield from iter_leaves(child, f"{path}.{label}" if path else label)


def make_other_value(node):
    """Return the text of another value of the same kind."""
    if isinstance(node.content, bool):
        return str(not node.content).lower()
    if isinstance(node.content, int):
        return str(2 * node.content or 1)
    number, _, unit = node.text.partition(" ")
    try:
        return f"{float(number) * 1.01 + (0.01 if float(number) == 0 else 0):.6g} {unit}".strip()
    except ValueError:
        return dump_node_on_one_line(node)


@pytest.mark.parametrize(
    ("part", "at_least"),
    nightly_except(3, [("scene", 15), ("chain", 8), ("impairments", 4), ("radar", 20)]),
)
def test_every_setting_changes_by_value_as_by_text(rich_scenario, part, at_least):
    settings_value = getattr(rich_scenario, part)
    if part == "impairments":
        settings_value = ImpairmentList(impairments=settings_value)
    assert count_changes(settings_value) >= at_least


@nightly
def test_every_scenario_setting_changes_by_value_as_by_text(rich_scenario):
    assert count_changes(rich_scenario) > 50


@frozen_dataclass
class ImpairmentList:
    """Settings that consist of impairments alone."""

    impairments: tuple[Impairment, ...]


def count_changes(settings_value):
    """Change every setting of a value both ways, one at a time, and count the changes."""
    n = 0
    for path, node in iter_leaves(parse_yaml(dump_yaml(settings_value), "")):
        text = make_other_value(node)
        if path.endswith("kind"):
            continue
        try:
            expected = set_by_text(settings_value, f"{path}={text}")
        except DechirpError:
            with pytest.raises(DechirpError):
                set_by_value(settings_value, path, text)
            continue
        assert set_by_value(settings_value, path, text) == expected, path
        n += expected != settings_value
    return n


@pytest.mark.parametrize(
    ("path", "family", "form"),
    [
        ("chain.cfar.estimator", NoiseEstimator, "{{kind: {}}}"),
        ("chain.angle", DirectionEstimator, "{{kind: {}}}"),
        ("chain.angle.kind", DirectionEstimator, "{}"),
        ("impairments", Impairment, "[{{kind: {}}}, {{kind: thermal-noise}}]"),
        ("scene.targets.van.body", Body, "{{kind: {}}}"),
    ],
)
def test_every_family_member_is_selected_by_value_as_by_text(rich_scenario, path, family, form):
    n = 0
    first, _, rest = path.partition(".")
    settings_value = (
        getattr(rich_scenario, first)
        if rest
        else ImpairmentList(impairments=rich_scenario.impairments)
    )
    path = rest or path
    for kind in family.members():
        text = form.format(kind)
        try:
            expected = set_by_text(settings_value, f"{path}={text}")
        except DechirpError:  # the member needs settings or another array
            with pytest.raises(DechirpError):
                set_by_value(settings_value, path, text)
            continue
        assert set_by_value(settings_value, path, text) == expected
        n += 1

    assert n >= 3


@pytest.mark.parametrize(
    "options",
    nightly_except(
        3,
        [
            ["chain.cluster=null"],
            ["ego_motion={}", "chain.angle.window=hann"],
            ["tracker.gate_probability=0.99"],
            ["radar.frame.chirp.n_samples=128", "chain.n_range_bins=128"],  # valid only together
            ["ego_motion.gate=3", "n_frames=4"],
            ["scene.targets.1.position.0=1 km", "scene.targets.car.name=coupe"],
            ["impairments.rain-attenuation.rate=8 mm/h", "impairments.0=null"],
            ["chain.angle.kind=music", "chain.angle.n_sources=2"],  # of the new kind
        ],
    ),
)
def test_combined_settings_change_by_value_as_by_text(rich_scenario, options):
    texts = dict(option.split("=") for option in options)
    try:
        expected = set_by_text(rich_scenario, *options)
    except InvalidFile as error:
        with pytest.raises(InvalidFile) as variant_error:
            ScenarioVariants(rich_scenario).scenario_with_settings(texts)
        assert [mistake.setting for mistake in variant_error.value.mistakes] == [
            mistake.setting for mistake in error.mistakes
        ]
        assert all(mistake.file is None for mistake in variant_error.value.mistakes)
    else:
        assert ScenarioVariants(rich_scenario).scenario_with_settings(texts) == expected


def make_study(scenario, *vary, scores=(), **settings):
    from dechirp.evaluation.score.processing_time import ProcessingTime

    return Study(scenario=scenario, scores=scores or (ProcessingTime(),), vary=vary, **settings)


RCS = SweptSetting(
    path="scene.targets.car.rcs",
    texts=("0 dBsm", "10 dBsm", "20 dBsm"),
    numbers=(0.0, 10.0, 20.0),
    unit="dBsm",
)
ANGLE = SweptSetting(path="chain.angle", texts=("null", "{kind: fft}"), labels=("none", "fft"))
RANGE = RandomSetting(
    path="scene.targets.car.position.0", distribution="uniform", first=10.0, second=50.0, unit="m"
)
LOSS = RandomSetting(
    path="radar.hardware.loss", distribution="normal", first=3.0, second=0.5, unit="dB"
)


def test_points_number_grid_with_last_list_fastest(one_target_scenario):
    plan = Plan.from_study(make_study(one_target_scenario, RCS, ANGLE))

    assert (plan.grid_shape, plan.n_points) == ((3, 2), 6)
    texts = [tuple(text for _, text in plan.setting_texts_of_point(point)) for point in range(6)]
    assert texts == list(product(RCS.texts, ANGLE.texts))
    assert [plan.grid_index_of_point(point) for point in range(6)] == list(
        product(range(3), range(2))
    )
    assert plan.setting_labels_of_point(3)[1] == ("chain.angle", "fft")
    assert plan.numeric_settings_of_point(3) == (10.0, None)
    for point in range(6):
        options = [f"{path}={text}" for path, text in plan.setting_texts_of_point(point)]
        assert plan.scenario_of_point(point) == set_by_text(one_target_scenario, *options)
    with pytest.raises(InvalidSetting, match="from 0 to 5"):
        plan.setting_texts_of_point(6)


def test_study_without_varied_settings_has_one_point(one_target_scenario):
    plan = Plan.from_study(make_study(one_target_scenario))

    assert (
        plan.n_points,
        plan.setting_texts_of_point(0),
        plan.drawn_setting_texts_of_trial(7),
    ) == (1, (), {})
    assert plan.scenario_of_point(0) is one_target_scenario


def test_random_points_are_crossed_with_grid(one_target_scenario):
    plan = Plan.from_study(make_study(one_target_scenario, RANGE, ANGLE, LOSS, draw=Sampling(n=8)))

    assert (plan.grid_shape, plan.n_points) == ((2, 8), 16)
    assert plan.drawn_setting_texts_of_trial(0) == {}
    for draw in range(8):
        first, second = (
            dict(plan.setting_texts_of_point(draw)),
            dict(plan.setting_texts_of_point(8 + draw)),
        )
        assert first.pop("chain.angle") != second.pop("chain.angle")
        assert first == second
    (path, text), _, _ = plan.setting_texts_of_point(5)
    assert float(text.removesuffix(" m")) == plan.numeric_settings_of_point(5)[0]
    assert (
        plan.scenario_of_point(5).scene.targets[0].position_m[0]
        == plan.numeric_settings_of_point(5)[0]
    )
    assert path == RANGE.path


def test_random_setting_without_draw_changes_per_trial(one_target_scenario):
    plan = Plan.from_study(make_study(one_target_scenario, RCS, RANGE, LOSS))
    trial_settings = [plan.drawn_setting_texts_of_trial(trial) for trial in range(2000)]

    assert (
        trial_settings[3]
        == plan.drawn_setting_texts_of_trial(3)
        == Plan.from_study(
            make_study(one_target_scenario, RANGE, LOSS)
        ).drawn_setting_texts_of_trial(3)
    )
    assert trial_settings[3] != Plan.from_study(
        make_study(one_target_scenario, RANGE, LOSS, seed=1)
    ).drawn_setting_texts_of_trial(3)
    assert plan.n_points == 3
    assert set(dict(plan.setting_texts_of_point(0))) == {RCS.path}
    ranges, losses = (
        np.array([float(settings[axis.path].split()[0]) for settings in trial_settings])
        for axis in (RANGE, LOSS)
    )
    # 2000 draws: a third of the uniform range, and one standard deviation of the normal one in dB.
    confidence = 1 - 1e-7
    low, high = binomial_interval(int(np.sum(ranges < 10 + 40 / 3)), 2000, confidence=confidence)
    assert low < 1 / 3 < high
    low, high = binomial_interval(
        int(np.sum(np.abs(losses - 3) < 0.5)), 2000, confidence=confidence
    )
    assert low < 0.6826895 < high
    low, high = binomial_interval(
        int(np.sum((losses > 3) == (ranges > 30))), 2000, confidence=confidence
    )
    assert low < 0.5 < high  # the two settings are independent
    scenario = plan.scenario_of_point(2, trial_settings[0])
    assert scenario.scene.targets[0].position_m[0] == ranges[0]
    assert scenario.radar.hardware.loss == pytest.approx(10 ** (losses[0] / 10), rel=1e-12)


def test_sobol_points_fill_cells_evenly(one_target_scenario):
    """256 points of two settings: one in each of 256 equal cells of nine different shapes."""
    plan = Plan.from_study(
        make_study(one_target_scenario, RANGE, LOSS, draw=Sampling(method="sobol", n=256))
    )
    from scipy.special import ndtr

    numbers = np.array([plan.numeric_settings_of_point(point) for point in range(256)])
    shares = np.stack([(numbers[:, 0] - 10) / 40, ndtr((numbers[:, 1] - 3) / 0.5)])
    assert np.all((shares > 0) & (shares < 1))
    for bits in range(9):
        rows, columns = 2**bits, 2 ** (8 - bits)
        cells = (shares[0] * rows).astype(int) * columns + (shares[1] * columns).astype(int)
        assert len(set(cells)) == 256, (rows, columns)
    other_plan = Plan.from_study(
        make_study(one_target_scenario, RANGE, LOSS, draw=Sampling(n=256), seed=1)
    )
    assert other_plan.numeric_settings_of_point(0) != plan.numeric_settings_of_point(0)


def test_independent_points_do_not_fill_cells_evenly(one_target_scenario):
    plan = Plan.from_study(
        make_study(one_target_scenario, RANGE, LOSS, draw=Sampling(method="independent", n=300))
    )
    shares = (
        np.array([plan.numeric_settings_of_point(point)[0] for point in range(256)]) - 10
    ) / 40

    # 256 random points in 256 cells leave 94 empty, with a spread of 8.
    assert 94 - 50 < 256 - len(set((shares * 256).astype(int))) < 94 + 50


def test_pickled_plan_is_small_and_complete(one_target_scenario):
    plan = Plan.from_study(make_study(one_target_scenario, RCS, ANGLE, RANGE))
    pickled_plan = pickle.dumps(plan)
    scenarios = [
        plan.scenario_of_point(point, plan.drawn_setting_texts_of_trial(1)) for point in range(6)
    ]

    assert len(pickle.dumps(plan)) == len(pickled_plan) < 20_000
    restored_plan = pickle.loads(pickled_plan)
    assert restored_plan.study == plan.study
    assert [
        restored_plan.scenario_of_point(point, restored_plan.drawn_setting_texts_of_trial(1))
        for point in range(6)
    ] == scenarios
    assert restored_plan.study_identity_texts() == plan.study_identity_texts()


def test_digest_differences_name_changed_settings(rich_scenario, tmp_path):
    (tmp_path / "box.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    text = "{kind: mesh, path: " + str(tmp_path / "box.obj") + "}"
    body = SweptSetting(path="scene.targets.van.body", texts=("{kind: van}", text))
    study = make_study(rich_scenario, RCS, body)
    earlier_digest = Plan.from_study(study).study_identity_texts()

    assert (
        describe_identity_changes(earlier_digest, Plan.from_study(study).study_identity_texts())
        == []
    )
    digest = Plan.from_study(
        make_study(set_by_text(rich_scenario, "n_frames=5"), RCS, body, seed=3)
    ).study_identity_texts()
    assert describe_identity_changes(earlier_digest, digest) == [
        "seed: 0 -> 3",
        "scenario.n_frames: 3 -> 5",
    ]
    digest = Plan.from_study(
        make_study(rich_scenario, SweptSetting(path=RCS.path, texts=("0 dBsm",)), body)
    ).study_identity_texts()
    (difference,) = describe_identity_changes(earlier_digest, digest)
    assert difference == f"vary.{RCS.path}: [0 dBsm, 10 dBsm, 20 dBsm] -> [0 dBsm]"
    assert describe_identity_changes(earlier_digest, {**earlier_digest, "version": "9"})[
        0
    ].endswith("-> 9")
    (tmp_path / "box.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    digest = Plan.from_study(study).study_identity_texts()
    assert describe_identity_changes(earlier_digest, digest) == [
        f"file {tmp_path / 'box.obj'}: other content"
    ]
    (tmp_path / "box.obj").unlink()
    assert (
        "not readable"
        in Plan.from_study(study).study_identity_texts()[f"file {tmp_path / 'box.obj'}"]
    )


@pytest.mark.parametrize(
    ("paths", "match"),
    [
        (["chain.angle", "chain.angle.window"], "cannot be combined with chain.angle"),
        (["scene.targets.car.rcs", "scene.targets.0.rcs"], "cannot be combined with"),
        (["scene.targets", "scene.targets.car.rcs"], "cannot be combined with"),
        (["tracker.gate_probability", "tracker"], "cannot be combined with tracker.gate"),
        (["chain.angle.kind", "chain.angle.window"], "cannot be combined with"),
        (["scene.targets.car.rcs.x"], "inside scene.targets.car.rcs"),
        (["scene.targets.bus.rcs"], "one of car, truck, van"),
        (["recording.frmes"], "frames"),
    ],
)
def test_rejects_settings_that_cannot_be_varied_together(rich_scenario, paths, match):
    axes = [SweptSetting(path=path, texts=("1", "2")) for path in paths]

    with pytest.raises(InvalidSetting, match=match):
        Plan.from_study(make_study(rich_scenario, *axes))
