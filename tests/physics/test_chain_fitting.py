"""Settings chosen for recordings: training cells, map of moving targets, largest range."""

import shlex
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.config import loading
from dechirp.config.dumping import dump_yaml
from dechirp.core.detection_columns import detections_from_columns, rows_to_show
from dechirp.core.errors import InvalidSetting
from dechirp.experiments.run import run
from dechirp.experiments.scenario import READERS, RecordingSource, Scenario
from dechirp.processing.cfar.base import Cells
from dechirp.processing.cfar.two_step import TwoStep
from dechirp.processing.chain import Chain
from dechirp.processing.chain_fitting import fit_chain_to_frames
from dechirp.processing.detect import detect
from dechirp.processing.moving_targets import MovingTargetMap
from dechirp.radar.cube import label_cube
from dechirp.recordings.samples.continuous import join_single_chirps
from nightly import nightly

N_CHIRPS, N_SAMPLES = 32, 128
CHIRP = dc.Chirp(
    start_frequency_hz=60e9,
    slope_hz_per_s=100e12,
    ramp_duration_s=70e-6,
    sample_rate_hz=2e6,
    n_samples=N_SAMPLES,
    sampling="complex",
)
RADAR = dc.Radar(frame=dc.Frame(chirp=CHIRP, n_chirps=N_CHIRPS, interval_s=500e-6))
CELL_M, VELOCITY_CELL = CHIRP.range_resolution_m, RADAR.frame.velocity_resolution_m_per_s


def make_cube(*tones, radar=RADAR, seed=1):
    """Make a frame of tones (range cell, velocity cell, SNR in dB after integration) in noise.

    White noise of unit power; amplitudes follow from the SNR of a frame without windows.
    """
    frame = radar.frame
    shape = frame.n_chirps, 1, frame.chirp.n_samples
    is_real = frame.chirp.sampling == "real"
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, *shape)) / np.sqrt(2)
    samples = noise[0] * np.sqrt(2) if is_real else noise[0] + 1j * noise[1]
    m, n = np.arange(shape[0])[:, None, None], np.arange(shape[2])
    for range_cell, velocity_cell, snr_db in tones:
        amplitude = np.sqrt(10 ** (snr_db / 10) / (shape[0] * shape[2]))
        turns = velocity_cell * m / shape[0] + range_cell * n / shape[2]
        tone = amplitude * np.exp(2j * np.pi * turns)
        samples = samples + (np.sqrt(2) * tone.real if is_real else tone)
    return label_cube(
        samples[None].astype(np.float32 if is_real else np.complex64), radar, units="1"
    )


def fit(cube, radar=RADAR, chain=Chain()):  # noqa: B008
    return fit_chain_to_frames(chain, radar, [cube.values[0]])


def ranges_in_cells(detections):
    return np.sort(detections.range.values / CELL_M)


STATIC = [(20.0, 0, 70), (24.2, 0, 68), (28.4, 0, 66), (31.8, 0, 44), (36.4, 0, 65), (40.2, 0, 67)]


@pytest.mark.parametrize(
    ("n_moving", "n_static", "expected"), [(30, 100, 10), (3, 100, 3), (30, 4, 16), (5, 5, 5)]
)
def test_table_for_people_leaves_half_its_rows_for_motion(n_moving, n_static, expected):
    rng = np.random.default_rng(1)
    moving = np.repeat([1.0, 0.0], [n_moving, n_static])
    snr = rng.uniform(1, 2, moving.size) * np.where(moving == 1, 1, 1000)
    places = rng.permutation(1000)[: moving.size]  # all different
    columns = {"snr": snr, "moving": moving, "range": 4.0 * places, "velocity": 0 * snr}
    columns["ambiguity_number"] = np.where(snr > 1.9, np.nan, 0.0)
    detections = xr.Dataset({name: ("detection", column) for name, column in columns.items()})

    rows = rows_to_show(detections, 20, range_cell_m=1.0, velocity_cell_m_per_s=0.1)

    assert rows.size == len(set(rows.tolist())) == min(20, n_moving + n_static)
    assert moving[rows].sum() == expected
    assert (np.diff(snr[rows]) <= 0).all()
    # The strongest of each; those that move and have a known ambiguity number before others.
    for is_kind in (moving == 0, (moving == 1) & (snr <= 1.9)):
        shown = np.sort(snr[rows][is_kind[rows]])[::-1]
        assert (np.sort(snr[is_kind])[::-1][: shown.size] == shown).all()
    is_unknown = (moving == 1) & (snr > 1.9)
    if is_unknown[rows].any():
        assert ((moving == 1) & (snr <= 1.9)).sum() < 10


def test_table_for_people_shows_each_place_once():
    rng = np.random.default_rng(2)
    strong, weak = rng.normal(0.30, 0.002, 64), rng.normal(0.46, 0.002, 64)
    columns = {
        "range": np.concatenate([strong, weak]),
        "velocity": rng.normal(0, 1e-4, 128),
        "snr": np.concatenate([rng.uniform(1e6, 2e6, 64), rng.uniform(1e5, 2e5, 64)]),
        "moving": np.zeros(128),
        "ambiguity_number": np.full(128, np.nan),
    }
    detections = xr.Dataset({name: ("detection", column) for name, column in columns.items()})

    rows = rows_to_show(detections, 20, range_cell_m=0.03, velocity_cell_m_per_s=0.06)

    assert rows.tolist() == [columns["snr"][:64].argmax(), 64 + columns["snr"][64:].argmax()]


def test_static_echo_between_others_is_detected_with_cells_along_velocity():
    cube = make_cube(*STATIC)
    hidden = ranges_in_cells(detect(cube, RADAR))
    assert abs(hidden - 31.8).min() > 1

    chain, choices = fit(cube)
    detections = detect(cube, RADAR, chain)

    assert (chain.cfar.n_training, chain.cfar.n_guard) == (
        Cells(range=0, velocity=8),
        Cells(range=0, velocity=4),
    )
    assert [choice.setting for choice in choices] == ["chain.cfar", "chain.moving_targets"]
    # The standard error at 44 dB is 0.003 cells; echoes of 66 dB beside it leave 1 % of a cell.
    assert ranges_in_cells(detections) == pytest.approx([tone[0] for tone in STATIC], abs=0.05)
    assert np.all(detections.moving.values == 0)


def test_detector_that_needs_cells_along_range_keeps_its_window():
    chain = Chain(cfar=replace(Chain().cfar, estimator=TwoStep()))

    fitted, choices = fit(make_cube(*STATIC), chain=chain)

    assert fitted.cfar == chain.fit_to_radar(RADAR).cfar
    assert [choice.setting for choice in choices] == ["chain.moving_targets"]


def test_default_window_stays_for_few_echoes():
    chain, choices = fit(make_cube((30, 0, 40), (60, 5, 40)))

    assert chain.cfar == Chain().fit_to_radar(RADAR).cfar
    assert [choice.setting for choice in choices] == ["chain.moving_targets"]


def test_nothing_is_chosen_in_noise():
    chain, choices = fit(make_cube())

    assert choices == ()
    assert chain == replace(Chain().fit_to_radar(RADAR), max_range_m=CHIRP.max_range_m)


def test_given_settings_stay():
    given = Chain(
        cfar=replace(Chain().cfar, n_training=Cells(range=6, velocity=6)),
        moving_targets=MovingTargetMap(),
        max_range_m=5.0,
    )

    chain, choices = fit(make_cube(*STATIC), chain=given)

    assert choices == ()
    assert chain == given.fit_to_radar(RADAR)


def test_static_and_moving_targets_are_both_marked():
    mover = 31.8, 5.3, 30
    cube = make_cube(*STATIC, mover)

    detections = detect(cube, RADAR, fit(cube)[0])

    moving = detections.isel(detection=np.flatnonzero(detections.moving.values == 1))
    assert moving.range.values / CELL_M == pytest.approx([mover[0]], abs=0.1)
    assert moving.velocity.values / VELOCITY_CELL == pytest.approx([mover[1]], abs=0.1)
    static = detections.isel(detection=np.flatnonzero(detections.moving.values == 0))
    assert ranges_in_cells(static) == pytest.approx([tone[0] for tone in STATIC], abs=0.05)


@nightly
def test_map_of_moving_targets_keeps_false_alarm_probability():
    # At 1e-3 a map of 32 x 128 cells, of which the filter leaves 29 x 128, has 3.7 false cells, of
    # which most are local maxima: as many as without static echoes. 60 frames, z below 5.
    cfar = replace(Chain().cfar, false_alarm_probability=1e-3)
    n_alarms = []
    for tones in ([], STATIC):
        chain = Chain(cfar=cfar, moving_targets=MovingTargetMap(cfar=cfar))
        frames = [make_cube(*tones, seed=seed) for seed in range(60)]
        detections = [detect(cube, RADAR, chain) for cube in frames]
        n_alarms.append(sum(int((found.moving == 1).sum()) for found in detections))

    assert n_alarms[0] > 100
    assert abs(n_alarms[1] - n_alarms[0]) < 5 * np.sqrt(sum(n_alarms))


def test_target_in_last_half_cell_keeps_its_range():
    # Its nearest cell is that of range zero; the standard error at 60 dB is 0.0004 cells.
    cube = make_cube((N_SAMPLES - 0.3, 0, 60))

    detections = detect(cube, RADAR)

    assert ranges_in_cells(detections) == pytest.approx([N_SAMPLES - 0.3], abs=0.01)


@pytest.mark.parametrize("leakage_cell", [-0.3, -0.8, -1.4, 0.2])
def test_leakage_is_no_target_at_largest_range(leakage_cell):
    cube = make_cube((leakage_cell, 0, 75), (30, 0, 50))

    chain, choices = fit(cube)
    ranges = ranges_in_cells(detect(cube, RADAR, chain))

    assert "chain.max_range" in [choice.setting for choice in choices]
    assert ranges[-1] == pytest.approx(30, abs=0.05)
    assert ranges[0] >= 0


@pytest.mark.parametrize(("near_cell", "image_cell"), [(3.4, -3.6), (3.6, -3.4), (8.4, -8.6)])
def test_image_of_near_echo_is_no_target_at_largest_range(near_cell, image_cell):
    # I/Q image below zero range, 30 dB weaker; peaks in cells of unequal distance from zero.
    chirp = replace(CHIRP, n_samples=512, ramp_duration_s=260e-6)
    radar = replace(RADAR, frame=replace(RADAR.frame, chirp=chirp))
    tones = (near_cell, 0, 80), (image_cell, 0, 50), (60, 0, 50)
    cube = make_cube(*tones, radar=radar)

    chain, choices = fit(cube, radar)

    assert "chain.max_range" in [choice.setting for choice in choices]
    ranges_m = np.sort(detect(cube, radar, chain).range.values)
    assert ranges_m / chirp.range_resolution_m == pytest.approx([near_cell, 60], abs=0.05)


def test_mirror_images_of_real_samples_are_no_targets():
    # Complex numbers that hold real samples, as of channels that were calibrated in phase.
    real_radar = replace(RADAR, frame=replace(RADAR.frame, chirp=replace(CHIRP, sampling="real")))
    real_cube = make_cube((20, 0, 60), (33.4, 6, 50), radar=real_radar)
    cube = label_cube(real_cube.values * np.complex64(np.exp(0.7j)), RADAR, units="1")
    assert ranges_in_cells(detect(cube, RADAR))[-1] > 100

    chain, choices = fit(cube)

    assert choices[-1].options == (f"chain.max_range={CHIRP.max_range_m / 2:.4g} m",)
    assert ranges_in_cells(detect(cube, RADAR, chain)) == pytest.approx([20, 33.4], abs=0.05)


def add_mixer_image(cube, level_db):
    """Add the image of an I/Q mixer with unequal branches: b conj(z) of the samples z."""
    samples = cube.values + 10 ** (level_db / 20) * np.exp(0.4j) * cube.values.conj()
    return label_cube(samples.astype(np.complex64), RADAR, units="1")


MOVERS = [(20.3, 5.3, 60), (33.4, -7.2, 55)]


@pytest.mark.parametrize("level_db", [-20, -6])
def test_images_of_mixer_are_no_targets(level_db):
    # Of the farther targets none is at the mirror of another: 100.2 cells at that of 27.8.
    truth = [*MOVERS, (100.2, 3.4, 45), (110.6, 0, 50)]
    cube = add_mixer_image(make_cube(*truth), level_db)
    assert ranges_in_cells(detect(cube, RADAR)).size > len(truth)

    chain, choices = fit(cube)

    assert choices[-1].options == (f"chain.image_rejection={-level_db - 3} dB",)
    detections = detect(cube, RADAR, chain)
    assert ranges_in_cells(detections) == pytest.approx([tone[0] for tone in truth], abs=0.05)


def test_images_of_mixer_with_delay_between_i_and_q_are_no_targets():
    # A delay of half a sample makes images of tan^2(pi f / 2 fs): -12 and -7 dB.
    levels_db = [20 * np.log10(np.tan(np.pi * cell / N_SAMPLES / 2)) for cell, *_ in MOVERS]
    images = [
        (-cell, -velocity, snr_db + level_db)
        for (cell, velocity, snr_db), level_db in zip(MOVERS, levels_db, strict=True)
    ]
    cube = make_cube(*MOVERS, *images)

    chain, _ = fit(cube)

    assert chain.image_rejection == pytest.approx(10**0.4)
    assert ranges_in_cells(detect(cube, RADAR, chain)) == pytest.approx(
        [tone[0] for tone in MOVERS], abs=0.05
    )


@pytest.mark.parametrize(
    "tones",
    [
        [(20, 0, 60), (-20, 0, 40), (30, 0, 60), (-30, 0, 40)],
        [(20.3, 5.3, 60), (-20.3, -5.3, 40)],
        [*MOVERS, (-20.3, 5.3, 40), (-33.4, -7.2, 35)],
        [(64, 0, 70), (64, 4, 50), (64, -4, 46), (64, 8, 45), (64, -8, 40)],
        MOVERS,
    ],
    ids=["static", "one", "velocities alike", "vibration at half of the axis", "no image"],
)
def test_echoes_that_prove_no_mixer_image_are_kept(tones):
    cube = make_cube(*tones)

    chain, choices = fit(cube)

    assert chain.image_rejection is None
    assert "chain.image_rejection" not in [choice.setting for choice in choices]
    assert detect(cube, RADAR, chain).sizes["detection"] == len(tones)


def make_cube_with_leakage_and_image(image_db, seed=3):
    """Make a frame with echoes in 16 cells next to zero range, of different powers, and images."""
    n_samples = 512
    radar = replace(
        RADAR,
        frame=replace(
            RADAR.frame, chirp=replace(CHIRP, n_samples=n_samples, ramp_duration_s=300e-6)
        ),
    )
    rng = np.random.default_rng(seed)
    near = [(cell, 0, 80 + 5 * rng.standard_normal()) for cell in range(1, 17)]
    turns = 2j * np.pi * rng.uniform(size=(2, 16))
    n = np.arange(n_samples)
    clean = np.zeros(n_samples, complex)
    for (cell, _, power_db), turn in zip(near, turns[0], strict=True):
        amplitude = np.sqrt(10 ** (power_db / 10) / (N_CHIRPS * n_samples))
        clean += amplitude * np.exp(2j * np.pi * cell * n / n_samples + turn)
    cube = make_cube((100.0, 0, 60), radar=radar)
    clean = clean + 10 ** (image_db / 20) * clean.conj()
    return cube + clean.astype(np.complex64), radar


def test_images_of_leakage_are_no_targets_at_largest_range():
    cube, radar = make_cube_with_leakage_and_image(-32.0)
    folded_m = (1 - 1 / 32) * radar.frame.chirp.max_range_m
    assert detect(cube, radar, Chain(cfar=fit(cube, radar)[0].cfar)).range.values.max() > folded_m

    chain, choices = fit(cube, radar)

    (choice,) = (choice for choice in choices if choice.setting == "chain.image_rejection")
    # The levels of single cells differ by the noise, and by the echoes beside them.
    assert 10 * np.log10(chain.image_rejection) == pytest.approx(29, abs=3)
    assert "leakage" in choice.reason
    detections = detect(cube, radar, chain)
    assert detections.range.values.max() < folded_m
    cells = detections.range.values / radar.frame.chirp.range_resolution_m
    assert abs(cells - 100).min() < 0.1


def test_echoes_at_the_largest_range_that_mirror_no_leakage_are_kept():
    cube, radar = make_cube_with_leakage_and_image(-120.0)
    other, _ = make_cube_with_leakage_and_image(-120.0, seed=4)

    # The echoes of another room, far away, 32 dB weaker.
    far = cube + 10**-1.6 * other.values.conj()

    assert fit(far, radar)[0].image_rejection is None


def test_image_rejection_below_0_db_is_refused():
    with pytest.raises(InvalidSetting, match="an image is weaker than its echo"):
        Chain(image_rejection=0.01)


def test_options_of_notes_repeat_the_run_together_and_one_by_one(tmp_path):
    path = tmp_path / "scene.h5"
    cube = make_cube(*STATIC, (31.8, 5.3, 30), (-0.3, 0, 75))
    dc.write(dc.recording_from_cube(cube, RADAR), path)
    scenario = Scenario(recording=RecordingSource(path=str(path)))
    chosen = run(scenario)

    choices = [
        [word for word in shlex.split(finding.value.split(" because ")[0]) if "=" in word]
        for finding in chosen.findings
        if " because " in finding.value
    ]
    together = sum(choices, ["recording.fit_chain=false"])
    assert len(together) == 7
    assert chosen.detections.sizes["detection"] == 7
    for overrides in (together, *choices):
        repeated = run(
            loading.parse_settings(
                dump_yaml(scenario), Scenario, file="", overrides=overrides, readers=READERS
            )
        )
        for name, column in chosen.detections.items():
            np.testing.assert_array_equal(repeated.detections[name], column)


@pytest.mark.parametrize("place", ["option", "file"])
def test_given_settings_stay_with_default_values(tmp_path, place):
    path = tmp_path / "frame.h5"
    dc.write(dc.recording_from_cube(make_cube(*STATIC, (31.8, 5.3, 30)), RADAR), path)
    cells = {"n_training": Cells(range=10, velocity=8), "n_guard": Cells(range=4, velocity=4)}
    options = ["chain.cfar.n_training.velocity=8", "chain.moving_targets=null"]
    file = tmp_path / "scenario.yaml"
    detector = "estimator: {kind: cell-averaging}, false_alarm_probability: 1e-6"
    cfar = f"{{{detector}, n_guard: {{range: 4, velocity: 4}}}}"
    chain = f"chain: {{cfar: {cfar}, moving_targets: null}}"
    file.write_text(f"recording: {{path: {path}}}\n{chain if place == 'file' else ''}\n")

    result = run(dc.load(file, options if place == "option" else []))
    written = loading.parse_settings(dump_yaml(result.scenario), Scenario, file="", readers=READERS)
    repeated = run(written)

    assert not [finding for finding in result.findings if "chosen" in finding.value]
    assert {name: getattr(result.scenario.chain.cfar, name) for name in cells} == cells
    assert result.scenario.chain.moving_targets is None
    assert written == repeated.scenario == result.scenario
    xr.testing.assert_identical(repeated.detections, result.detections)


def test_other_settings_of_a_detector_leave_its_cells_to_be_chosen(tmp_path):
    path = tmp_path / "frame.h5"
    dc.write(dc.recording_from_cube(make_cube(*STATIC), RADAR), path)
    file = tmp_path / "scenario.yaml"
    file.write_text(
        f"recording: {{path: {path}}}\nchain: {{cfar: {{estimator: {{kind: cell-averaging}},"
        f" false_alarm_probability: 1e-5}}}}\n"
    )

    result = run(dc.load(file, ["chain.cfar.false_alarm_probability=1e-4"]))

    assert result.scenario.chain.cfar.n_training == Cells(range=0, velocity=8)


@pytest.mark.parametrize(
    ("interval_s", "n_chirps", "n_joined"),
    [(41e-3, 486, 8), (15.8e-3, 3536, 16), (12e-3, 1024, 16), (1e-3, 5000, 256), (41e-3, 7, 1)],
)
def test_single_chirps_are_joined_to_frames_of_a_third_of_a_second(interval_s, n_chirps, n_joined):
    radar = replace(RADAR, frame=replace(RADAR.frame, n_chirps=1, interval_s=interval_s))

    joined, findings = join_single_chirps(radar, n_chirps)

    assert joined.frame.n_chirps == n_joined
    assert [found.setting for found in findings] == (
        ["radar.frame.n_chirps", "radar.frame.interval"] if n_joined > 1 else []
    )


def test_table_shows_both_directions_of_a_cell_once():
    # Two sources in one cell of ten frames, and a weaker echo elsewhere in one of them.
    frame = np.repeat(np.arange(10), 2)
    detections = detections_from_columns(
        {
            "frame": np.append(frame, 3),
            "range": np.append(np.full(20, 5.0), 9.0),
            "velocity": np.zeros(21),
            "snr": np.append(np.tile([200.0, 100.0], 10), 50.0),
            "azimuth": np.append(np.tile([0.2, -0.2], 10), 0.0),
            "azimuth_std": np.full(21, 0.01),
        }
    )

    rows = rows_to_show(detections, 5, range_cell_m=1.0, velocity_cell_m_per_s=0.1)

    shown = detections.isel(detection=rows)
    assert shown.azimuth.values.tolist() == [0.2, -0.2, 0.0]
