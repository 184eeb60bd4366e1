"""Report of a run: self-contained page with figures, tables and findings of the result."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from dechirp.cli.run_output import _detection_table_cells
from dechirp.config.quantities import parse_quantity
from dechirp.core.conventions import axis_coordinate
from dechirp.core.detection_columns import decimals_of_estimates
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import (
    EN_DASH,
    decimals_for_column,
    decimals_for_std,
    format_probability,
    format_si,
    format_with_si_prefix,
    format_with_std,
)
from dechirp.evaluation.association import associate_detections
from dechirp.experiments.run import run
from dechirp.experiments.scenario import Scenario
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.moving_targets import MovingTargetMap
from dechirp.processing.range_doppler_map import power_map
from dechirp.radar.array import Array
from dechirp.radar.budget import received_power_w
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.report.figures import bars, range_doppler
from dechirp.report.figures.range_doppler import block_maxima
from dechirp.report.figures.style import reduce_line_to_extremes
from dechirp.report.page import render_report
from dechirp.report.page_context import sort_match_and_locate_detections
from dechirp.scene.aliasing import apparent_range_and_velocity, range_doppler_map_position
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
from nightly import nightly, nightly_except
from page_checks import check_captions, check_pdf_contains_page_text

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


def simulate_echoes(scene: Scene, n_frames: int) -> xr.DataArray:
    """Simulate echoes by the textbook formula in white noise 10 dB above them, seed 1."""
    frame, rng = RADAR.frame, np.random.default_rng(1)
    target_truth = truth(scene, RADAR, n_frames=n_frames)
    slow_s = np.arange(frame.n_chirps) * frame.interval_s
    fast_s = np.arange(CHIRP.n_samples) / CHIRP.sample_rate_hz
    amplitude = np.sqrt(received_power_w(RADAR, range_m=50.0, rcs_m2=10.0))
    parts = rng.standard_normal((n_frames, 128, 1, 2200, 2), dtype=np.float32)
    cube = parts.view(np.complex64)[..., 0] * np.float32(np.sqrt(10 / 2) * amplitude)
    for index in range(n_frames):
        for target in range(target_truth.sizes["target"]):
            state = target_truth.isel(frame=index, target=target)
            doppler_hz = 2 * float(state.velocity) / CHIRP.wavelength_m
            beat_hz = CHIRP.beat_frequency_hz(float(state.range)) + doppler_hz
            phase = doppler_hz * slow_s[:, None] + beat_hz * fast_s
            cube[index, :, 0] += amplitude * np.exp(2j * np.pi * phase)
    return xr.DataArray(
        cube,
        dims=("frame", "chirp", "rx", "sample"),
        coords={
            "chirp": axis_coordinate("chirp", slow_s),
            "sample": axis_coordinate("sample", fast_s),
        },
        attrs={"units": "W**0.5"},
    )


def compute_map(cube: xr.DataArray) -> xr.DataArray:
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


def make_detections(n: int = 1, n_frames: int = 1) -> xr.Dataset:
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
    unknown_columns = (
        "azimuth",
        "elevation",
        "azimuth_std",
        "elevation_std",
        "ambiguity_number",
        "ambiguity_confidence",
    )
    columns |= {name: np.full(n, np.nan) for name in unknown_columns}
    return xr.Dataset({name: ("detection", values) for name, values in columns.items()})


def make_budget_line(
    name: str, level_db: float, kind: str, unit: str, formula: str
) -> SimpleNamespace:
    return SimpleNamespace(name=name, level_db=level_db, kind=kind, unit=unit, formula=formula)


BUDGET = (
    make_budget_line("transmit power", 10.0, "level", "dBm", "Pt"),
    make_budget_line("transmit antenna", 20.0, "step", "dB", "G"),
    make_budget_line("spreading, echo and aperture", -138.17, "step", "dB", "λ² RCS / (4π)³ R⁴"),
    make_budget_line("receive antenna", 20.0, "step", "dB", "G"),
    make_budget_line("losses", 0.0, "step", "dB", "1 / L"),
    make_budget_line("received power", -88.17, "level", "dBm", "Pt G² λ² RCS / (4π)³ R⁴ L"),
    make_budget_line(
        "noise in one sample", -78.17, "level", "dBm", "as set: -10 dB below the echo"
    ),
    make_budget_line("SNR in one sample", -10.0, "level", "dB", "received power / noise"),
    make_budget_line("integration gain", 54.5, "step", "dB", "N M"),
    make_budget_line("range window", -1.76, "step", "dB", "noise bandwidth, Hann"),
    make_budget_line("Doppler window", -1.76, "step", "dB", "noise bandwidth, Hann"),
    make_budget_line("SNR after integration", 40.98, "level", "dB", "what the threshold sees"),
    make_budget_line(
        "required", 13.2, "level", "dB", "detection probability 0.9 at 1e-6 false alarms"
    ),
    make_budget_line("margin", 27.78, "step", "dB", "SNR after integration less required"),
)


def make_result(**changes) -> SimpleNamespace:
    """Make a result of the reference scenario; keyword arguments replace its attributes."""
    scene = changes.pop("scene", Scene(targets=(CAR,)))
    n_frames = changes.pop("n_frames", 1)
    cube = simulate_echoes(scene, n_frames)
    power = compute_map(cube)
    run_result = SimpleNamespace(
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
            group_tracker=None,
        ),
        radar=RADAR,
        n_frames=n_frames,
        frames=lambda: (cube.isel(frame=slice(k, k + 1)) for k in range(n_frames)),
        cube=cube,
        power=power,
        threshold=xr.full_like(power, 14.0 * float(np.median(power)) / np.log(2)),
        detections=make_detections(),
        ego=None,
        clusters=None,
        tracks=None,
        traffic=None,
        vital_signs=None,
        displacement=None,
        truth=truth(scene, RADAR, n_frames=n_frames),
        findings=(),
        timing_s={"simulate": 0.21, "range-Doppler map": 0.013, "CFAR": 0.008, "peaks": 0.0006},
        budget=BUDGET,
    )
    for name, value in changes.items():
        setattr(run_result, name, value)
    return run_result


def make_recorded_result() -> SimpleNamespace:
    run_result = make_result(
        truth=None, budget=None, radar=dataclasses.replace(RADAR, hardware=None)
    )
    run_result.scenario.scene = None
    run_result.scenario.recording = SimpleNamespace(path="captures/street.bin")
    run_result.cube.attrs["units"] = "1"
    return run_result


def render_page(run_result: SimpleNamespace, yaml: str = "name: reference\nseed: 1\n") -> str:
    return render_report(run_result, yaml=yaml)


@pytest.fixture(scope="module")
def page() -> str:
    return render_page(make_result())


def find_sections(page: str) -> set[str]:
    return set(re.findall(r'<section id="(\w+)"', page))


@pytest.mark.parametrize(
    ("std", "text"),
    [
        (0.0012, "0.0012"),
        (0.00098, "0.00098"),
        (0.000998, "0.0010"),  # rounded up to the next power of ten: two digits still
        (0.96, "0.96"),
        (0.996, "1.0"),
        (40.0, "40.0"),
    ],
)
def test_standard_error_is_rounded_to_two_digits(std, text):
    assert f"{std:.{decimals_for_std(std)}f}" == text


@pytest.mark.parametrize(
    ("stds", "digits", "decimals"),
    [
        ([0.0021, 0.3], 1, 3),
        ([0.0021, 0.3], 2, 4),
        ([3.0, np.nan], 2, 1),
        ([2e-9], 2, 6),
        ([np.nan, 0.0], 1, 3),
        ([], 1, 3),
    ],
)
def test_rows_of_column_share_digits_of_smallest_standard_error(stds, digits, decimals):
    assert decimals_for_column(np.array(stds), digits=digits) == decimals


@pytest.mark.parametrize(
    ("std_m", "digits", "decimals"),
    [
        (0.02, 2, 3),
        (0.0021, 2, 4),
        (3e-6, 2, 5),  # a hundredth of the cell of 27.3 mm is 0.27 mm
        (3e-6, 1, 4),
    ],
)
def test_tables_show_two_digits_of_errors_above_a_hundredth_of_a_cell(std_m, digits, decimals):
    detections = make_detections(2).assign(
        range_std=("detection", [std_m, 0.5]), azimuth_std=("detection", [1e-6, 1e-6])
    )

    shown = decimals_of_estimates(
        detections, range_cell_m=0.0273, velocity_cell_m_per_s=1.0, digits=digits
    )

    assert shown["range"] == decimals
    assert shown["azimuth"] == 2


@pytest.mark.parametrize(
    ("amount", "unit", "text"),
    [
        (2e-5, "s", "20 us"),
        (-3e13, "hz_per_s", "-30 MHz/us"),
        (1.6e-2, "w", "12.041 dBm"),
        (0.0, "s", "0 s"),
        (np.inf, "hz", "inf Hz"),
    ],
)
def test_quantity_in_message_has_prefix_and_is_accepted_as_setting(amount, unit, text):
    assert format_si(amount, unit) == text
    if np.isfinite(amount):
        assert parse_quantity(text, unit) == pytest.approx(amount, rel=1e-4)


@pytest.mark.parametrize(
    ("std", "text"),
    [(0.0021, "1.234 ± 0.002"), (2e-9, "1.234 ± <0.001"), (0.0, "1.234 ± 0.000")],
)
def test_known_standard_error_is_never_written_as_zero(std, text):
    assert format_with_std(1.2341, std, 3).replace("\N{NO-BREAK SPACE}", " ") == text


def test_page_loads_no_external_resources(page):
    resources = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?\s*([^"')> ]+)""", page)
    assert all(resource.startswith(("#", "data:")) for resource in resources)
    assert page.count("<script") == 1 and "@import" not in page and "<link" not in page
    assert "http:" not in page and "https:" not in page


def test_report_of_simulation_shows_every_section_and_names_target(page):
    assert find_sections(page) == {*SECTIONS, "scene", "budget"}
    assert "<h1>Target at 50.00\xa0m, 10.00\xa0m/s</h1>" in page
    assert "Power (dBm)" in page


def test_report_of_recording_has_no_scene_budget_truth_or_dbm():
    page = re.sub(r"data:[^\"]+", "", render_page(make_recorded_result()))

    assert find_sections(page) == set(SECTIONS)
    assert "Recorded in street.bin" in page
    assert "dBFS" in page and "dBm" not in page
    assert "truth" not in page


def test_detection_table_shows_values_with_standard_errors(page):
    assert "50.001 ±\N{NO-BREAK SPACE}0.004" in page
    assert "10.003 ±\N{NO-BREAK SPACE}0.008" in page
    target_truth = truth(Scene(targets=(CAR,)), RADAR).isel(target=0, frame=0)
    error_m = 50.0012 - float(target_truth.range)
    assert f"{error_m:+.3f}".replace("-", "\N{MINUS SIGN}") in page
    assert f"{abs(error_m) / 0.0039:.1f}\N{NO-BREAK SPACE}\N{GREEK SMALL LETTER SIGMA}" in page
    assert f"{10 * np.log10(12_500):.1f}" in page


def test_tables_of_report_and_terminal_write_motion_in_words():
    run_result = make_recorded_result()
    run_result.detections = make_detections(3)
    run_result.detections["moving"] = "detection", [1.0, 0.0, np.nan]

    rows = re.findall(r"<tr>(.*?)</tr>", render_page(run_result), flags=re.DOTALL)
    heading = next(row for row in rows if ">Moving<" in row)
    column = re.findall(r"<th.*?>(.*?)</th>", heading).index("Moving")
    in_report = [
        re.findall(r"<td.*?>(.*?)</td>", row)[column]
        for row in rows[rows.index(heading) + 1 : rows.index(heading) + 4]
    ]
    assert in_report == ["yes", "no", "\N{EN DASH}"]
    assert _detection_table_cells(run_result, run_result.detections)["moving"] == in_report


@nightly
def test_names_from_files_are_escaped():
    hostile_name = "<script>alert(1)</script>$\\frac$ & \"'"
    page = render_page(
        make_result(
            scene=Scene(targets=(dataclasses.replace(CAR, name=hostile_name),)),
            findings=(
                Finding(level="warning", setting=hostile_name, value="a", expected="b", fix="c"),
            ),
        ),
        yaml=f"name: {hostile_name}",
    )

    assert page.count("<script") == 1  # the script of the page
    assert page.count("&lt;script&gt;alert(1)") >= 4  # table, scene, finding, settings


@pytest.mark.usefixtures("without_figures")
def test_table_of_bodies_has_no_error_columns():
    page = render_page(make_result(scene=Scene(targets=(WALKER,))))

    assert "Bodies have no errors" in page
    assert "Range error (m)" not in page and "Errors are relative to" not in page
    assert "Range error (m)" in render_page(make_result())


@pytest.mark.usefixtures("without_figures")
def test_report_without_detections_has_notice():
    page = render_page(make_result(detections=make_detections(0)))

    assert "<h1>Nothing detected</h1>" in page
    assert "No peak of the map exceeds its threshold." in page


@pytest.mark.usefixtures("without_figures")
def test_report_of_empty_scene_has_scene_section():
    page = render_page(make_result(scene=Scene(), detections=make_detections(0), budget=None))

    assert "scene" in find_sections(page) and "budget" not in find_sections(page)
    assert "No targets" in page


@pytest.mark.usefixtures("without_figures")
def test_report_lists_strongest_fifty_of_many_detections():
    page = render_page(make_result(detections=make_detections(3000)))

    assert "2950 more are in" in page
    assert page.count(" ±\N{NO-BREAK SPACE}") < 2 * 50 + 10
    assert len(page) < 1_500_000


@nightly
def test_report_accepts_infinite_thresholds():
    run_result = make_result()
    run_result.threshold[:, :60] = np.inf
    assert "Cut along range" in render_page(run_result)
    run_result.threshold[:] = np.inf
    assert "Cut along range" in render_page(run_result)


@nightly
def test_silent_recording_has_report():
    run_result = make_recorded_result()
    run_result.cube[:] = 0
    run_result.power[:] = 0
    run_result.detections = make_detections(0)
    assert "Nothing detected" in render_page(run_result)


@pytest.mark.usefixtures("without_figures")
def test_report_of_several_frames_shows_detections_over_time():
    page = render_page(make_result(n_frames=3, detections=make_detections(6, n_frames=3)))

    assert "frames" in find_sections(page)
    assert '<th class="num">Frame</th>' in page


@nightly
def test_map_of_moving_targets_contains_no_static_echo(monkeypatch):
    static = dataclasses.replace(CAR, name="post", velocity_m_per_s=(0, 0, 0))
    moving_result = make_result(scene=Scene(targets=(CAR, static)), detections=make_detections(2))
    moving_result.detections["moving"] = "detection", [1.0, 0.0]
    chain = dataclasses.replace(moving_result.scenario.chain, moving_targets=MovingTargetMap())
    moving_result.scenario.chain = chain.fit_to_radar(RADAR)
    drawn, draw_map = [], range_doppler.draw_map

    def record_map(axes, marked, **options):
        drawn.append(marked)
        return draw_map(axes, marked, **options)

    monkeypatch.setattr(range_doppler, "draw_map", record_map)
    page = render_page(moving_result)

    assert page.count("Map of moving targets.") == 1
    marked = drawn[-1]
    assert marked.detections.velocity_m_per_s == pytest.approx([10.0034], abs=0.01)
    # Both echoes of 54.5 - 10 dB over the noise: that of the post is below it in the second map.
    near_post = {"range": slice(49, 51), "velocity": slice(-0.5, 0.5)}
    assert drawn[0].power.sel(near_post).max() > 1e3 * drawn[0].power.median()
    assert marked.power.sel(near_post).max() < 0.1 * marked.power.median()
    assert marked.power.sel(range=slice(49, 51)).max() > 1e3 * marked.power.median()


def test_figures_have_captions(page):
    check_captions(page)


@nightly
def test_pdf_contains_all_text(page):
    check_pdf_contains_page_text(page)


@nightly
def test_same_result_gives_same_page(page):
    assert render_page(make_result()) == page


def test_page_size_stays_below_1_5_mb(page):
    assert len(page.encode()) < 1_500_000
    images = re.findall(r"data:image/png;base64,([^\"]+)", page)
    assert images and sum(map(len, images)) < 300_000


def test_strong_cell_survives_reduction_of_large_map():
    power = np.random.default_rng(3).exponential(size=(1024, 4096)).astype(np.float32)
    power[611, 2999] = 1e6

    reduced_map = block_maxima(power)

    assert reduced_map.max() == 1e6
    assert reduced_map.size < 100_000
    row, column = np.unravel_index(reduced_map.argmax(), reduced_map.shape)
    assert abs(row / reduced_map.shape[0] - 611.5 / 1024) < 1 / reduced_map.shape[0]
    assert abs(column / reduced_map.shape[1] - 2999.5 / 4096) < 1 / reduced_map.shape[1]


def test_spike_survives_thinning_of_long_line():
    y = np.random.default_rng(4).normal(size=50_000)
    y[31_234], y[8_003] = 99.0, -99.0

    x, thinned_y = reduce_line_to_extremes(np.arange(y.size), y)

    assert x.size <= 1200
    assert 31_234 in x and 8_003 in x
    assert np.all(y[x] == thinned_y)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_aliased_target_is_expected_at_peak_of_its_echo(sampling):
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
    target = Target(position_m=(1.3 * chirp.max_range_m, 0, 0), velocity_m_per_s=(speed, 0, 0))
    scene = Scene(targets=(target,))
    with pytest.warns(PhysicsWarning):
        cube = simulate(scene, radar, impairments=(), seed=1)

    expected = range_doppler_map_position(
        apparent_range_and_velocity(truth(scene, radar), radar), radar
    )

    power = power_map(cube.isel(frame=0), radar, Chain())
    row, column = np.unravel_index(int(power.values.argmax()), power.shape)
    # Half a cell from the peak to the nearest cell, and a tenth for the move within the frame.
    assert abs(expected.range_m.item() - power.range[column]) < 0.6 * chirp.range_resolution_m
    error = expected.velocity_m_per_s.item() - power.velocity[row]
    assert abs(error) < 0.6 * frame.velocity_resolution_m_per_s


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("n_tx", [1, 2])
def test_truth_over_time_is_aliased_like_its_detections_and_map_like_one_tx(n_tx):
    """Two TDM transmitters resolve the velocity ambiguity by direction; both maps end at 27 m/s."""
    interval_s = 5 * CHIRP.ramp_duration_s / n_tx
    multiplexing = Tdm(order=(0, 1)) if n_tx == 2 else None
    radar = dataclasses.replace(
        RADAR,
        frame=Frame(chirp=CHIRP, n_chirps=64, interval_s=interval_s, multiplexing=multiplexing),
        array=Array(
            tx_m=((0, 0, 0), (0, 7.8e-3, 0))[:n_tx],
            rx_m=tuple((0, 1.95e-3 * index, 0) for index in range(4)),
        ),
    )
    scene = Scene(targets=[dataclasses.replace(CAR, velocity_m_per_s=(-40, 0, 0), rcs_m2=100)])
    result = run(Scenario(radar=radar, scene=scene, n_frames=2))
    context = sort_match_and_locate_detections(result)

    assert radar.frame.max_velocity_m_per_s == pytest.approx(26.5, abs=0.5)
    expected = -40 if n_tx == 2 else -40 + 2 * radar.frame.max_velocity_m_per_s
    assert context.apparent_truth.velocity_m_per_s == pytest.approx(expected, abs=0.1)
    assert context.strongest.velocity.values[:2] == pytest.approx(expected, abs=0.1)
    map_velocity = -40 + 2 * radar.frame.max_velocity_m_per_s
    assert context.point_target_map_positions.velocity_m_per_s == pytest.approx(
        map_velocity, abs=0.1
    )


@nightly
def test_beat_signal_shows_full_echo_amplitude_with_tdm():
    """Echoes of elements two wavelengths apart differ by half a cycle at a sine of 1/4."""
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

    def measure_height(color: str) -> float:
        line = re.search(rf'<path d="([^"]*)"[^>]*stroke: {color}', signal)[1]
        y = [float(point) for point in re.findall(r"[ML] \S+ (\S+)", line)]
        return max(y) - min(y)

    assert measure_height("#1d2733") == pytest.approx(measure_height("#8fbbdb"), rel=0.1)


def make_point_pair_scene(**scatterer_options) -> Scene:
    """Return a body 50 m away with scatterers at its origin and 6 m, ten cells, behind it."""
    near_scatterer = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0)
    far_scatterer = Scatterer(position_m=(6, 0, 0), rcs_m2=1.0, **scatterer_options)
    return Scene(
        targets=(
            dataclasses.replace(
                CAR, rcs_m2=1.0, body=Points(scatterers=(near_scatterer, far_scatterer))
            ),
        )
    )


def place_detections(range_m: list[float], velocity: float) -> xr.Dataset:
    dataset = make_detections(len(range_m))
    dataset["range"] = ("detection", np.array(range_m))
    dataset["velocity"] = ("detection", np.full(len(range_m), velocity))
    return dataset


def test_hidden_side_of_car_matches_no_detection():
    car = dataclasses.replace(CAR, rcs_m2=1.0, velocity_m_per_s=(0, 0, 0), body=Car(length_m=15))
    scene = Scene(targets=(car,))
    target_truth = truth(scene, RADAR)

    # The car faces away: its rear is 7.5 m nearer than its origin, its front is hidden.
    association = associate_detections(
        place_detections([42.5, 57.5], 0.0), target_truth, RADAR, scene
    )

    assert association.target.tolist() == [0, -1]
    peaks = sort_match_and_locate_detections(make_result(scene=scene)).scatterer_map_positions
    assert peaks.range_m.min() == pytest.approx(42.5, abs=0.2)
    assert peaks.range_m.max() < 57


@pytest.mark.usefixtures("without_figures")
def test_corner_reflector_facing_away_matches_no_detection():
    corner = dataclasses.replace(CAR, rcs_m2=1.0, body=CornerReflector(edge_m=0.1))
    scene = Scene(targets=(corner,))
    target_truth = truth(scene, RADAR)

    assert (
        associate_detections(
            place_detections([target_truth.range.item()], 10.0), target_truth, RADAR, scene
        ).target[0]
        == -1
    )
    row = re.search(r"<tr><td>car</td>(.*?)</tr>", render_page(make_result(scene=scene)))[1]
    assert re.sub(r"<[^>]*>", " ", row).split() == [EN_DASH, "50.00", "10.00", "0.0", EN_DASH, "no"]


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("away_m", nightly_except(1, [50.0, 5000.0]))
def test_rotating_body_has_spectrogram_at_unaliased_and_aliased_range(away_m):
    turn = Rotation(center_m=(0, 0, 0), rate_rad_per_s=100.0)
    wheel = Scatterer(position_m=(0, 0, 0.3), rcs_m2=1.0, rotation=turn)
    van = dataclasses.replace(
        CAR, rcs_m2=1.0, position_m=(away_m, 0, 0), body=Points(scatterers=(wheel,))
    )
    run_result = make_result(scene=Scene(targets=(van,)))

    assert "spectrogram" in find_sections(render_page(run_result))


@pytest.mark.usefixtures("without_figures")
def test_report_of_few_chirps_has_no_spectrogram():
    cube, n_chirps = simulate_echoes(Scene(targets=(CAR,)), 1), 2
    radar = dataclasses.replace(RADAR, frame=dataclasses.replace(RADAR.frame, n_chirps=n_chirps))
    run_result = make_result(
        radar=radar, cube=cube.isel(chirp=slice(n_chirps)), scene=Scene(targets=(WALKER,))
    )

    assert "spectrogram" not in find_sections(render_page(run_result))


@nightly
def test_report_describes_bodies_paths_and_summation_kernel():
    bike = Target(
        name="bike",
        position_m=(30, 5, 0),
        waypoints=[Waypoint(time_s=1.0, position_m=(34, 5, 0))],
    )
    scene = Scene(
        targets=(*make_point_pair_scene().targets, bike),
        ego=Ego(yaw_rad=0.2, velocity_m_per_s=(5, 0, 0), turn_rate_rad_per_s=0.3),
    )
    run_result = make_result(scene=scene)
    run_result.cube.attrs["kernels"] = "direct"
    run_result.scenario.engine = Engine(tolerance=1e-4, late="onset")

    page = render_page(run_result)

    for phrase in ("path through waypoints", "scatterers of bodies", "Bodies have no errors"):
        assert phrase in page
    for phrase in ("auto: direct", "10⁻⁴ of the RMS value", "start on arrival"):
        assert phrase in page
    assert "of the RMS value" not in render_page(make_recorded_result())


@nightly
def test_page_with_many_scatterers_stays_small():
    positions_m = np.random.default_rng(5).uniform(-3, 3, (20_000, 3))
    cloud = PointCloud(positions_m=positions_m, rcs_m2=np.full(20_000, 1e-4))
    scene = Scene(targets=(dataclasses.replace(CAR, rcs_m2=1.0, body=cloud),))

    assert len(render_page(make_result(scene=scene)).encode()) < 1_500_000


def test_link_budget_bars_are_contiguous():
    power, ratio = bars.link_budget_bars(BUDGET)

    assert [len(power.rows), len(ratio.rows)] == [7, 7]
    gain, window_loss = ratio.rows[1], ratio.rows[2]
    assert gain.left + gain.width == pytest.approx(window_loss.left + window_loss.width)
    assert window_loss.kind == "loss" and gain.kind == "gain"
    integrated_snr, margin = ratio.rows[4], ratio.rows[6]
    assert integrated_snr.left + integrated_snr.width == pytest.approx(margin.left + margin.width)
    for row in (*power.rows, *ratio.rows):
        assert row.left >= -1e-9 and row.left + row.width <= 100 + 1e-9


def test_si_format_has_prefix_and_no_trailing_zeros():
    assert format_with_si_prefix(149.896e6, "Hz", 6) == "149.896 MHz"
    assert format_with_si_prefix(7.3333e-6, "s", 5) == "7.3333 µs"
    assert format_with_si_prefix(999.99999, "Hz") == "1000 Hz"
    assert format_with_si_prefix(0.0, "s") == "0 s"
    assert format_probability(1e-6) == "10⁻⁶"
    assert format_probability(2.5e-5).endswith("10⁻⁵")
