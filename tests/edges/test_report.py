"""The report: one page that stands alone and says what the result says."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from dechirp.core.conventions import axis_coordinate
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import EN_DASH, decimals_for_std, format_probability, format_si
from dechirp.evaluation.association import associate_detections
from dechirp.experiments.run import run
from dechirp.experiments.scenario import Scenario
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map
from dechirp.radar.array import Array
from dechirp.radar.budget import received_power_w
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.report.figures import bars
from dechirp.report.figures.range_doppler import block_maxima
from dechirp.report.figures.style import thin_line
from dechirp.report.page import render_report
from dechirp.report.page_context import build_page_context
from dechirp.scene.aliasing import apparent_truth, map_position
from dechirp.scene.bodies.corner_reflector import CornerReflector
from dechirp.scene.bodies.pedestrian import Pedestrian
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.bodies.points import Points, Rotation, Scatterer
from dechirp.scene.bodies.vehicle import Car
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.scene.waypoints import Waypoint
from dechirp.simulation.engine import Engine
from dechirp.simulation.simulate import simulate
from printed import check_captions, check_pdf

CHIRP = Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=150e6 / 7.3333e-6,
    ramp_duration_s=7.3334e-6,
    sample_rate_hz=300e6,
    n_samples=2200,
    sampling="complex",
)
RADAR = Radar(
    frame=Frame(chirp=CHIRP, n_chirps=128, interval_s=7.3334e-6),
    hardware=Hardware(transmit_power_w=0.01, antenna_gain=100.0, noise_factor=10.0),
)
CAR = Target(name="car", position_m=(50, 0, 0), velocity_m_per_s=(10, 0, 0), rcs_m2=10.0)
WALKER = dataclasses.replace(CAR, rcs_m2=1.0, body=Pedestrian(speed_m_per_s=1.4))
SECTIONS = ["detections", "beat", "map", "threshold", "settings", "findings", "timing", "reproduce"]


def samples(scene: Scene, n_frames: int) -> xr.DataArray:
    """Make echoes by the textbook formula in white noise 10 dB above them, seed 1."""
    frame, rng = RADAR.frame, np.random.default_rng(1)
    known = truth(scene, RADAR, n_frames=n_frames)
    slow_s = np.arange(frame.n_chirps) * frame.interval_s
    fast_s = np.arange(CHIRP.n_samples) / CHIRP.sample_rate_hz
    amplitude = np.sqrt(received_power_w(RADAR, range_m=50.0, rcs_m2=10.0))
    parts = rng.standard_normal((n_frames, 128, 1, 2200, 2), dtype=np.float32)
    cube = parts.view(np.complex64)[..., 0] * np.float32(np.sqrt(10 / 2) * amplitude)
    for index in range(n_frames):
        for target in range(known.sizes["target"]):
            one = known.isel(frame=index, target=target)
            doppler_hz = 2 * float(one.velocity) / CHIRP.wavelength_m
            beat_hz = CHIRP.beat_frequency_hz(float(one.range)) + doppler_hz
            phase = doppler_hz * slow_s[:, None] + beat_hz * fast_s
            cube[index, :, 0] += amplitude * np.exp(2j * np.pi * phase)
    return xr.DataArray(
        cube,
        dims=("frame", "chirp", "rx", "sample"),
        coords={
            "chirp": axis_coordinate("chirp", slow_s),
            "sample": axis_coordinate("sample", fast_s),
        },
        attrs={"units": "sqrt(W)"},
    )


def map_of(cube: xr.DataArray) -> xr.DataArray:
    """Transform the first frame, Hann windows, (velocity, range)."""
    first = cube.values[0, :, 0]
    windows = np.outer(np.hanning(first.shape[0]), np.hanning(first.shape[1]))
    spectrum = np.fft.fftshift(np.fft.fft2(first * windows / windows.sum()), axes=0)
    doppler_hz = np.fft.fftshift(np.fft.fftfreq(128, RADAR.frame.interval_s))
    return xr.DataArray(
        abs(spectrum).astype(np.float32) ** 2,
        dims=("velocity", "range"),
        coords={
            "velocity": axis_coordinate("velocity", doppler_hz * CHIRP.wavelength_m / 2),
            "range": axis_coordinate("range", np.arange(2200) * CHIRP.range_resolution_m),
        },
    )


def detections(n: int = 1, n_frames: int = 1) -> xr.Dataset:
    """Return the car, and weaker false alarms after it."""
    rng = np.random.default_rng(2)
    range_m, velocity = rng.uniform(1, 2000, n), rng.uniform(-100, 100, n)
    range_m[:1], velocity[:1] = 50.0012, 10.0034
    snr = np.sort(rng.uniform(20, 100, n))[::-1].copy()
    snr[:1] = 12_500.0
    frame = np.arange(n) % n_frames
    start_s = frame * RADAR.frame.duration_s
    columns = {
        "frame": frame,
        "time": start_s + RADAR.frame.mid_frame_s,
        "range": range_m,
        "velocity": velocity,
        "snr": snr,
        "range_std": 0.0039 / np.sqrt(snr / 12_500),
        "velocity_std": 0.0081 / np.sqrt(snr / 12_500),
    }
    not_told = (
        "azimuth",
        "elevation",
        "azimuth_std",
        "elevation_std",
        "ambiguity_number",
        "ambiguity_confidence",
    )
    columns |= {name: np.full(n, np.nan) for name in not_told}
    return xr.Dataset({name: ("detection", values) for name, values in columns.items()})


def line(name: str, level_db: float, kind: str, unit: str, formula: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, level_db=level_db, kind=kind, unit=unit, formula=formula)


BUDGET = (
    line("transmit power", 10.0, "level", "dBm", "Pt"),
    line("transmit antenna", 20.0, "step", "dB", "G"),
    line("spreading, echo and aperture", -138.17, "step", "dB", "λ² RCS / (4π)³ R⁴"),
    line("receive antenna", 20.0, "step", "dB", "G"),
    line("losses", 0.0, "step", "dB", "1 / L"),
    line("received power", -88.17, "level", "dBm", "Pt G² λ² RCS / (4π)³ R⁴ L"),
    line("noise in one sample", -78.17, "level", "dBm", "as set: -10 dB below the echo"),
    line("SNR in one sample", -10.0, "level", "dB", "received power / noise"),
    line("integration gain", 54.5, "step", "dB", "N M"),
    line("range window", -1.76, "step", "dB", "noise bandwidth, Hann"),
    line("Doppler window", -1.76, "step", "dB", "noise bandwidth, Hann"),
    line("SNR after integration", 40.98, "level", "dB", "what the threshold sees"),
    line("required", 13.2, "level", "dB", "detection probability 0.9 at 1e-6 false alarms"),
    line("margin", 27.78, "step", "dB", "SNR after integration less required"),
)


def result(**changes) -> SimpleNamespace:
    """Make a run of the reference scenario; what is given replaces its parts."""
    scene = changes.pop("scene", Scene(targets=(CAR,)))
    n_frames = changes.pop("n_frames", 1)
    cube = samples(scene, n_frames)
    power = map_of(cube)
    made = SimpleNamespace(
        first_frame=0,
        scenario=SimpleNamespace(
            name="reference",
            seed=1,
            n_frames=n_frames,
            chain=Chain(cfar=Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)),
            impairments=(),
            engine=Engine(),
            scene=scene,
            recording=None,
            tracker=None,
        ),
        radar=RADAR,
        n_frames=n_frames,
        frames=lambda: (cube.isel(frame=slice(k, k + 1)) for k in range(n_frames)),
        cube=cube,
        power=power,
        threshold=xr.full_like(power, 14.0 * float(np.median(power)) / np.log(2)),
        detections=detections(),
        ego=None,
        clusters=None,
        tracks=None,
        truth=truth(scene, RADAR, n_frames=n_frames),
        findings=(),
        timing_s={"simulate": 0.21, "range-Doppler map": 0.013, "CFAR": 0.008, "peaks": 0.0006},
        budget=BUDGET,
    )
    for name, thing in changes.items():
        setattr(made, name, thing)
    return made


def recorded() -> SimpleNamespace:
    made = result(truth=None, budget=None, radar=dataclasses.replace(RADAR, hardware=None))
    made.scenario.scene = None
    made.scenario.recording = SimpleNamespace(path="captures/street.bin")
    made.cube.attrs["units"] = "full scale"
    return made


def page_of(made: SimpleNamespace, yaml: str = "name: reference\nseed: 1\n") -> str:
    return render_report(made, yaml=yaml)


@pytest.fixture(scope="module")
def page() -> str:
    return page_of(result())


def sections(page: str) -> set[str]:
    return set(re.findall(r'<section id="(\w+)"', page))


@pytest.mark.parametrize(
    ("std", "told"),
    [
        (0.0012, "0.0012"),
        (0.00098, "0.00098"),
        (0.000998, "0.0010"),  # rounded up to the next power of ten: two digits still
        (0.96, "0.96"),
        (0.996, "1.0"),
        (40.0, "40.0"),
    ],
)
def test_a_standard_error_has_two_digits(std, told):
    assert f"{std:.{decimals_for_std(std)}f}" == told


def test_the_page_asks_nothing_of_any_other_place(page):
    outside = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?\s*([^"')> ]+)""", page)
    assert all(place.startswith(("#", "data:")) for place in outside)
    assert page.count("<script") == 1 and "@import" not in page and "<link" not in page
    assert "http:" not in page and "https:" not in page


def test_a_simulation_shows_every_section_and_the_target_first(page):
    assert sections(page) == {*SECTIONS, "scene", "budget"}
    assert "<h1>Target at 50.00 m, 10.00 m/s</h1>" in page
    assert "Power (dBm)" in page


def test_a_recording_has_no_scene_no_budget_no_truth_and_no_watts():
    page = re.sub(r"data:[^\"]+", "", page_of(recorded()))

    assert sections(page) == set(SECTIONS)
    assert "Recorded in street.bin" in page
    assert "dBFS" in page and "dBm" not in page
    assert "truth" not in page


def test_the_table_gives_the_numbers_of_the_dataset_and_their_errors(page):
    assert "50.0012 ±\N{NO-BREAK SPACE}0.0039" in page
    assert "10.0034 ±\N{NO-BREAK SPACE}0.0081" in page
    known = truth(Scene(targets=(CAR,)), RADAR).isel(target=0, frame=0)
    error_m = 50.0012 - float(known.range)
    assert f"{error_m:+.4f}".replace("-", "\N{MINUS SIGN}") in page
    assert f"{abs(error_m) / 0.0039:.1f}\N{NO-BREAK SPACE}\N{GREEK SMALL LETTER SIGMA}" in page
    assert f"{10 * np.log10(12_500):.1f}" in page


def test_names_from_files_stay_text():
    hostile = "<script>alert(1)</script>$\\frac$ & \"'"
    page = page_of(
        result(
            scene=Scene(targets=(dataclasses.replace(CAR, name=hostile),)),
            findings=(Finding(level="warning", setting=hostile, value="a", expected="b", fix="c"),),
        ),
        yaml=f"name: {hostile}",
    )

    assert page.count("<script") == 1  # our own
    assert page.count("&lt;script&gt;alert(1)") >= 4  # table, scene, finding, settings


def test_of_bodies_alone_the_table_has_no_columns_of_errors():
    page = page_of(result(scene=Scene(targets=(WALKER,))))

    assert "Bodies have no errors" in page
    assert "Range error (m)" not in page and "Errors are relative to" not in page
    assert "Range error (m)" in page_of(result())


def test_a_page_without_detections_says_so():
    page = page_of(result(detections=detections(0)))

    assert "<h1>Nothing detected</h1>" in page
    assert "No peak of the map exceeds its threshold." in page


def test_an_empty_scene_is_a_scene_all_the_same():
    page = page_of(result(scene=Scene(), detections=detections(0), budget=None))

    assert "scene" in sections(page) and "budget" not in sections(page)
    assert "No targets" in page


def test_of_thousands_of_detections_the_strongest_fifty_are_listed():
    page = page_of(result(detections=detections(3000)))

    assert "2950 more are in" in page
    assert page.count(" ±\N{NO-BREAK SPACE}") < 2 * 50 + 10
    assert len(page) < 1_500_000


def test_cells_that_are_not_tested_have_no_threshold_to_draw():
    made = result()
    made.threshold[:, :60] = np.inf
    assert "Cut along range" in page_of(made)
    made.threshold[:] = np.inf
    assert "Cut along range" in page_of(made)


def test_a_silent_recording_has_a_page():
    made = recorded()
    made.cube[:] = 0
    made.power[:] = 0
    made.detections = detections(0)
    assert "Nothing detected" in page_of(made)


def test_several_frames_show_detections_over_time():
    page = page_of(result(n_frames=3, detections=detections(6, n_frames=3)))

    assert "frames" in sections(page)
    assert '<th class="num">Frame</th>' in page


def test_every_figure_says_what_to_see_and_the_pdf_says_all_of_the_page(page):
    check_captions(page)
    check_pdf(page)


def test_the_same_result_gives_the_same_page(page):
    assert page_of(result()) == page


def test_the_page_stays_small_enough_to_send(page):
    assert len(page.encode()) < 1_500_000
    images = re.findall(r"data:image/png;base64,([^\"]+)", page)
    assert images and sum(map(len, images)) < 300_000


def test_a_single_strong_cell_survives_the_reduction_of_a_large_map():
    power = np.random.default_rng(3).exponential(size=(1024, 4096)).astype(np.float32)
    power[611, 2999] = 1e6

    small = block_maxima(power)

    assert small.max() == 1e6
    assert small.size < 100_000
    row, column = np.unravel_index(small.argmax(), small.shape)
    assert abs(row / small.shape[0] - 611.5 / 1024) < 1 / small.shape[0]
    assert abs(column / small.shape[1] - 2999.5 / 4096) < 1 / small.shape[1]


def test_a_spike_survives_the_thinning_of_a_long_line():
    y = np.random.default_rng(4).normal(size=50_000)
    y[31_234], y[8_003] = 99.0, -99.0

    x, thin = thin_line(np.arange(y.size), y)

    assert x.size <= 1200
    assert 31_234 in x and 8_003 in x
    assert np.all(y[x] == thin)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_target_beyond_the_ambiguity_limits_is_expected_where_its_echo_peaks(sampling):
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        ramp_duration_s=26e-6,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling=sampling,
    )
    frame = Frame(chirp=chirp, n_chirps=64, interval_s=30e-6)
    radar = dataclasses.replace(RADAR, frame=frame)
    speed = 2 * frame.max_velocity_m_per_s + 10
    away = Target(position_m=(1.3 * chirp.max_range_m, 0, 0), velocity_m_per_s=(speed, 0, 0))
    scene = Scene(targets=(away,))
    with pytest.warns(PhysicsWarning):
        cube = simulate(scene, radar, impairments=(), seed=1)

    expected = map_position(apparent_truth(truth(scene, radar), radar), radar)

    power = power_map(cube.isel(frame=0), radar, Chain())
    row, column = np.unravel_index(int(power.values.argmax()), power.shape)
    # Half a cell from the peak to the nearest cell, and a tenth for the move within the frame.
    assert abs(expected.range_m.item() - power.range[column]) < 0.6 * chirp.range_resolution_m
    off = expected.velocity_m_per_s.item() - power.velocity[row]
    assert abs(off) < 0.6 * frame.velocity_resolution_m_per_s


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("n_tx", [1, 2])
def test_over_time_the_truth_has_the_fold_of_its_detections_on_the_map_none(n_tx):
    """Two transmitters in turns tell folds by direction; their map goes to 27 m/s, as does
    that of one which sends as often."""
    interval_s = 5 * CHIRP.ramp_duration_s / n_tx
    turns = Tdm(order=(0, 1)) if n_tx == 2 else None
    radar = dataclasses.replace(
        RADAR,
        frame=Frame(chirp=CHIRP, n_chirps=64, interval_s=interval_s, multiplexing=turns),
        array=Array(
            tx_m=((0, 0, 0), (0, 7.8e-3, 0))[:n_tx],
            rx_m=tuple((0, 1.95e-3 * place, 0) for place in range(4)),
        ),
    )
    scene = Scene(targets=[dataclasses.replace(CAR, velocity_m_per_s=(-40, 0, 0), rcs_m2=100)])
    result = run(Scenario(radar=radar, scene=scene, n_frames=2))
    view = build_page_context(result)

    assert radar.frame.max_velocity_m_per_s == pytest.approx(26.5, abs=0.5)
    told = -40 if n_tx == 2 else -40 + 2 * radar.frame.max_velocity_m_per_s
    assert view.apparent_truth.velocity_m_per_s == pytest.approx(told, abs=0.1)
    assert view.strongest.velocity.values[:2] == pytest.approx(told, abs=0.1)
    on_map = -40 + 2 * radar.frame.max_velocity_m_per_s
    assert view.expected_peaks.velocity_m_per_s == pytest.approx(on_map, abs=0.1)


def test_the_echo_in_the_samples_is_whole_where_transmitters_take_turns():
    """At a sine of 1/4 the echoes of elements two wavelengths apart are half a turn apart."""
    chirp = dataclasses.replace(CHIRP, n_samples=128)
    radar = dataclasses.replace(
        RADAR,
        frame=Frame(
            chirp=chirp,
            n_chirps=16,
            interval_s=chirp.ramp_duration_s,
            multiplexing=Tdm(order=(0, 1)),
        ),
        array=Array(tx_m=((0, 0, 0), (0, 2 * chirp.wavelength_m, 0)), rx_m=((0, 0, 0),)),
    )
    scene = Scene(targets=[dataclasses.replace(CAR, position_m=(48.4, 12.5, 0), rcs_m2=1e6)])

    page = render_report(run(Scenario(radar=radar, scene=scene)), yaml="")
    signal = page[page.index('aria-label="Beat signal') :]

    def height(color: str) -> float:
        line = re.search(rf'<path d="([^"]*)"[^>]*stroke: {color}', signal)[1]
        y = [float(point) for point in re.findall(r"[ML] \S+ (\S+)", line)]
        return max(y) - min(y)

    assert height("#1d2733") == pytest.approx(height("#8fbbdb"), rel=0.1)


def pair_of_points(**of_target) -> Scene:
    """A body 50 m away with scatterers at its origin and 6 m, ten cells, behind it."""
    near = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0)
    far = Scatterer(position_m=(6, 0, 0), rcs_m2=1.0, **of_target)
    return Scene(
        targets=(dataclasses.replace(CAR, rcs_m2=1.0, body=Points(scatterers=(near, far))),)
    )


def at(range_m: list[float], velocity: float) -> xr.Dataset:
    found = detections(len(range_m))
    found["range"] = ("detection", np.array(range_m))
    found["velocity"] = ("detection", np.full(len(range_m), velocity))
    return found


def test_the_far_side_of_a_car_is_no_place_of_the_truth():
    car = dataclasses.replace(CAR, rcs_m2=1.0, velocity_m_per_s=(0, 0, 0), body=Car(length_m=15))
    scene = Scene(targets=(car,))
    known = truth(scene, RADAR)

    # It faces away: its tail is 7.5 m nearer than its origin and seen, its nose as far is hidden.
    matched = associate_detections(at([42.5, 57.5], 0.0), known, RADAR, scene)

    assert matched.target.tolist() == [0, -1]
    marked = build_page_context(result(scene=scene)).scatterer_peaks
    assert marked.range_m.min() == pytest.approx(42.5, abs=0.2)
    assert marked.range_m.max() < 57


def test_a_body_that_faces_elsewhere_is_nowhere():
    corner = dataclasses.replace(CAR, rcs_m2=1.0, body=CornerReflector(edge_m=0.1))
    scene = Scene(targets=(corner,))
    known = truth(scene, RADAR)

    assert associate_detections(at([known.range.item()], 10.0), known, RADAR, scene).target[0] == -1
    row = re.search(r"<tr><td>car</td>(.*?)</tr>", page_of(result(scene=scene)))[1]
    assert re.sub(r"<[^>]*>", " ", row).split() == [EN_DASH, "50.00", "10.00", "0.0", EN_DASH, "no"]


@pytest.mark.parametrize("away_m", [50.0, 5000.0])
def test_what_turns_and_swings_is_shown_over_time_also_where_ranges_fold(away_m):
    turn = Rotation(center_m=(0, 0, 0), rate_rad_per_s=100.0)
    wheel = Scatterer(position_m=(0, 0, 0.3), rcs_m2=1.0, rotation=turn)
    van = dataclasses.replace(
        CAR, rcs_m2=1.0, position_m=(away_m, 0, 0), body=Points(scatterers=(wheel,))
    )
    made = result(scene=Scene(targets=(van,)))

    assert "spectrogram" in sections(page_of(made))


def test_a_few_chirps_have_no_velocity_over_time():
    cube, few = samples(Scene(targets=(CAR,)), 1), 2
    radar = dataclasses.replace(RADAR, frame=dataclasses.replace(RADAR.frame, n_chirps=few))
    made = result(radar=radar, cube=cube.isel(chirp=slice(few)), scene=Scene(targets=(WALKER,)))

    assert "spectrogram" not in sections(page_of(made))


def test_a_page_tells_bodies_ways_and_how_echoes_were_summed():
    bike = Target(
        name="bike",
        position_m=(30, 5, 0),
        waypoints=[Waypoint(time_s=1.0, position_m=(34, 5, 0))],
    )
    scene = Scene(
        targets=(*pair_of_points().targets, bike),
        ego=Ego(yaw_rad=0.2, velocity_m_per_s=(5, 0, 0), turn_rate_rad_per_s=0.3),
    )
    made = result(scene=scene)
    made.cube.attrs["kernels"] = "direct"
    made.scenario.engine = Engine(tolerance=1e-4, late="onset")

    page = page_of(made)

    for words in ("path through waypoints", "scatterers of bodies", "Bodies have no errors"):
        assert words in page
    for words in ("auto: direct", "10⁻⁴ of the RMS value", "start on arrival"):
        assert words in page
    assert "of the RMS value" not in page_of(recorded())


def test_a_page_of_very_many_scatterers_stays_small():
    at_m = np.random.default_rng(5).uniform(-3, 3, (20_000, 3))
    crowd = PointCloud(positions_m=at_m, rcs_m2=np.full(20_000, 1e-4))
    scene = Scene(targets=(dataclasses.replace(CAR, rcs_m2=1.0, body=crowd),))

    assert len(page_of(result(scene=scene)).encode()) < 1_500_000


def test_a_step_of_the_link_budget_starts_where_the_line_above_it_ends():
    power, ratio = bars.link_budget_bars(BUDGET)

    assert [len(power.rows), len(ratio.rows)] == [7, 7]
    gain, window = ratio.rows[1], ratio.rows[2]
    assert gain.left + gain.width == pytest.approx(window.left + window.width)
    assert window.kind == "loss" and gain.kind == "gain"
    after, margin = ratio.rows[4], ratio.rows[6]
    assert after.left + after.width == pytest.approx(margin.left + margin.width)
    for row in (*power.rows, *ratio.rows):
        assert row.left >= -1e-9 and row.left + row.width <= 100 + 1e-9


def test_numbers_carry_a_prefix_and_no_idle_digits():
    assert format_si(149.896e6, "Hz", 6) == "149.896 MHz"
    assert format_si(7.3333e-6, "s", 5) == "7.3333 µs"
    assert format_si(999.99999, "Hz") == "1000 Hz"
    assert format_si(0.0, "s") == "0 s"
    assert format_probability(1e-6) == "10⁻⁶"
    assert format_probability(2.5e-5).endswith("10⁻⁵")
