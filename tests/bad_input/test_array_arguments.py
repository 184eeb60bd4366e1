"""Invalid arguments of all public functions on plain arrays: one clear error with their name."""

import inspect
import warnings
from functools import partial

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr

import dechirp as dc
from bad_input.entries import check_error_is_complete
from dechirp.processing.angle.base import Directions
from nightly import nightly, nightly_except

Numbers = int | float | list | np.ndarray
LINE = 0.5 * np.arange(8)
SNAPSHOTS = np.exp(-2j * np.pi * LINE * np.sin(0.2)) * np.array([[1.0], [1.0j], [-1.0]])
POWER = np.random.default_rng(1).exponential(size=(20, 30))
DIRECTIONS = {"snapshots": SNAPSHOTS, "positions": LINE, "n_sources": 1, "noise_power": 0.1}
DETECTION = {"detection_probability": 0.9, "false_alarm_probability": 1e-6}
CELLS = {"n_training": 16}
RADAR_EQUATION = {
    "rcs_m2": 10.0,
    "transmit_power_w": 0.01,
    "frequency_hz": 77e9,
    "tx_gain": 10.0,
    "rx_gain": 10.0,
    "loss": 1.2,
}
NOISE = {"noise_factor": 15.0, "sample_rate_hz": 5e6}
ATMOSPHERE = {"pressure_pa": 1e5, "temperature_k": 288.0, "vapour_kg_per_m3": 0.0075}
TRIMMED = {**CELLS, "n_smallest": 2, "n_largest": 4}
WEIGHTS = {"weights": np.hanning(8)}
FACTOR = {"factor": 12.0}
SNR = {"snr": 20.0}
PFA = {"false_alarm_probability": 1e-6}

FRAME = {"samples": np.ones((4, 8)), "window": "hann", "axes": (0, 1), "n_bins": (4, 8)}

VALID_ARGUMENTS = {
    "maps.range_doppler_map": FRAME,
    "maps.range_doppler_spectrum": FRAME,
    "maps.range_spectrum": {"samples": np.ones((4, 8)), "window": "hann", "axis": 1, "n_bins": 8},
    "cfar.cfar_threshold": {
        "power": POWER,
        "n_training": 3,
        "n_guard": 1,
        "pfa": 1e-3,
        "kind": "cell-averaging",
        "axis": (0, 1),
        "n_summed": 1,
        "window": "rectangular",
        "n_points": (20, 30),
        "sampling": "complex",
    },
    "cfar.find_peaks": {"power": POWER, "threshold": 2.0},
    "angle.estimate_directions": {**DIRECTIONS, "kind": "music", "axis": -1},
    "angle.direction_spectrum": {
        **DIRECTIONS,
        "kind": "capon",
        "axis": -1,
        "azimuth_rad": [0.0, 0.1],
        "elevation_rad": 0.0,
    },
    "angle.snapshots_from_covariance": {"covariance": np.diag([1.0, 2.0]), "n_snapshots": 3},
    **{
        f"angle.{name}": DIRECTIONS
        for name in (
            *("bartlett", "capon", "esprit", "fft", "iterative_adaptive", "maximum_likelihood"),
            *("monopulse", "music", "root_music"),
        )
    },
    "theory.detection_probability": {**SNR, **PFA, "n_summed": 2, "swerling": 1},
    "theory.required_snr": {**DETECTION, "n_summed": 2, "swerling": 1},
    "theory.detection_threshold": {**PFA, "n_summed": 2},
    "theory.exceedance_probability": {**SNR, "threshold": 13.0, "n_summed": 2, "swerling": 1},
    "theory.coherent_detection_probability": {**SNR, **PFA},
    "theory.coherent_required_snr": DETECTION,
    "theory.albersheim": {**DETECTION, "n_summed": 2},
    "theory.shnidman": {**DETECTION, "n_summed": 2, "swerling": 1},
    "theory.binary_integration_probability": {"probability": 0.5, "m": 2, "n": 4},
    "theory.cfar_factor": {**PFA, **CELLS, "kind": "cell-averaging", "n_summed": 2},
    "theory.cell_averaging_factor": {**PFA, **CELLS, "n_summed": 2},
    "theory.cell_averaging_false_alarm_probability": {**FACTOR, **CELLS, "n_summed": 2},
    "theory.cell_averaging_detection_probability": {
        **SNR,
        **FACTOR,
        **CELLS,
        "n_summed": 2,
        "swerling": 1,
    },
    "theory.cell_averaging_loss": {**DETECTION, **CELLS, "n_summed": 2, "swerling": 1},
    "theory.cell_averaging_required_snr": {**DETECTION, **CELLS, "n_summed": 2, "swerling": 1},
    "theory.greatest_of_factor": {**PFA, **CELLS, "n_summed": 2},
    "theory.greatest_of_false_alarm_probability": {**FACTOR, **CELLS, "n_summed": 2},
    "theory.greatest_of_detection_probability": {**SNR, **FACTOR, **CELLS},
    "theory.smallest_of_factor": {**PFA, **CELLS, "n_summed": 2},
    "theory.smallest_of_false_alarm_probability": {**FACTOR, **CELLS, "n_summed": 2},
    "theory.smallest_of_detection_probability": {**SNR, **FACTOR, **CELLS},
    "theory.ordered_statistic_factor": {**PFA, **CELLS, "rank": 12, "n_summed": 2},
    "theory.ordered_statistic_false_alarm_probability": {
        **FACTOR,
        **CELLS,
        "rank": 12,
        "n_summed": 2,
    },
    "theory.ordered_statistic_detection_probability": {**SNR, **FACTOR, **CELLS, "rank": 12},
    "theory.trimmed_mean_factor": {**PFA, **TRIMMED},
    "theory.trimmed_mean_false_alarm_probability": {**FACTOR, **TRIMMED},
    "theory.trimmed_mean_detection_probability": {**SNR, **FACTOR, **TRIMMED},
    "theory.binomial_interval": {"hits": 3, "trials": 10, "confidence": 0.95},
    "theory.mean_interval": {"values": [1.0, 2.0, 3.0], "confidence": 0.95},
    "theory.rms_interval": {"values": [1.0, 2.0, 3.0], "confidence": 0.95},
    "theory.rate_interval": {"counts": [1, 2, 3], "exposure": 2.0, "confidence": 0.95},
    "theory.crlb_range": {**SNR, "n_samples": 64, "sample_rate_hz": 5e6, "slope_hz_per_s": 20e12},
    "theory.crlb_velocity": {**SNR, "n_chirps": 64, "interval_s": 40e-6, "wavelength_m": 4e-3},
    "theory.crlb_angle": {
        **SNR,
        "positions_m": [0.0, 0.002],
        "wavelength_m": 0.004,
        "angle_rad": 0.1,
    },
    "theory.decoupled_range_std_m": {
        "range_std_m": 0.01,
        "velocity_std_m_per_s": 0.1,
        "mid_window_frequency_hz": 77e9,
        "slope_hz_per_s": 20e12,
    },
    "theory.crlb_directions": {
        "positions": [0.0, 0.5, 1.0],
        "azimuth_rad": [0.1],
        "source_covariance": [2.0],
        "noise_power": 1.0,
        "n_snapshots": 10,
    },
    "theory.frequency_variance": {**SNR, "n_points": 64},
    "theory.monopulse_std_rad": {**SNR, "beamwidth_rad": 0.1},
    "theory.noncoherent_effective_snr": {**SNR, "n_channels": 4},
    "theory.direction_std_rad": {
        "positions": [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]],
        "azimuth_rad": [0.1],
        "elevation_rad": 0.0,
        "amplitudes": [1.0],
        "noise_power": 0.1,
    },
    "theory.alpha_beta_gains": {"tracking_index": 0.5},
    "theory.gate_threshold": {"gate_probability": 0.99, "n_dimensions": 2},
    "theory.drop_fall_speed_m_per_s": {"diameter_m": 1e-3},
    "theory.drop_size_density_per_m4": {"diameter_m": 1e-3, "rate_m_per_s": 1e-6},
    "theory.rain_db_per_km": {"frequency_hz": 77e9, "rate_m_per_s": 1e-6, "tilt_rad": 0.0},
    "theory.rain_power_law": {"frequency_hz": 77e9},
    "theory.rain_reflectivity_per_m": {
        "frequency_hz": 77e9,
        "rate_m_per_s": 1e-6,
        "temperature_k": 283.0,
    },
    "theory.rain_reflectivity_per_m4": {
        "frequency_hz": 77e9,
        "rate_m_per_s": 1e-6,
        "temperature_k": 283.0,
    },
    "theory.fog_db_per_km": {
        "frequency_hz": 77e9,
        "water_kg_per_m3": 1e-4,
        "temperature_k": 283.0,
    },
    "theory.gas_db_per_km": {"frequency_hz": 77e9, **ATMOSPHERE},
    "theory.oxygen_db_per_km": {"frequency_hz": 77e9, **ATMOSPHERE},
    "theory.vapour_db_per_km": {"frequency_hz": 77e9, **ATMOSPHERE},
    "theory.water_film_loss": {"frequency_hz": 77e9, "film_m": 1e-4, "temperature_k": 283.0},
    "theory.water_relative_permittivity": {"frequency_hz": 77e9, "temperature_k": 283.0},
    "theory.knife_edge_field": {"v": 0.5},
    "theory.knife_edge_loss_db": {"v": 0.5},
    "theory.sphere_rcs_m2": {"radius_m": 1e-3, "wavelength_m": 4e-3},
    "windows.window_weights": {"window": "hann", "n": 8},
    "windows.chebyshev_weights": {"n": 8, "sidelobe_db": 60.0},
    "windows.taylor_weights": {"n": 8, "n_bar": 4, "sidelobe_db": 30.0},
    "windows.kaiser_weights": {"n": 8, "beta": 6.0},
    "windows.half_main_lobe_bins": {"window": "hann"},
    "windows.coherent_gain": WEIGHTS,
    "windows.noise_bandwidth_bins": WEIGHTS,
    "windows.scalloping_loss": WEIGHTS,
    "windows.bin_correlation": {**WEIGHTS, "n_bins": 16, "lags": np.array([0, 1])},
    "link_budget.beat_frequency": {
        "range_m": 50.0,
        "slope_hz_per_s": 20e12,
        "velocity_m_per_s": 10.0,
        "frequency_hz": 77e9,
    },
    "link_budget.range_from_beat": {"beat_frequency_hz": 1e6, "slope_hz_per_s": 20e12},
    "link_budget.received_power": {"range_m": 50.0, **RADAR_EQUATION},
    "link_budget.noise_power": NOISE,
    "link_budget.sample_snr": {"range_m": 50.0, **RADAR_EQUATION, **NOISE},
    "link_budget.max_range": {
        "required_snr": 20.0,
        **RADAR_EQUATION,
        **NOISE,
        "integration_gain": 1e3,
    },
    "link_budget.range_resolution": {"bandwidth_hz": 1e9},
    "link_budget.unambiguous_range": {"sample_rate_hz": 5e6, "slope_hz_per_s": 20e12},
    "link_budget.velocity_resolution": {"frequency_hz": 77e9, "duration_s": 5e-3},
    "link_budget.unambiguous_velocity": {"frequency_hz": 77e9, "interval_s": 40e-6},
    "link_budget.ula_beamwidth": {"n_elements": 8, "spacing": 0.5, "angle_rad": 0.1},
}
# Their first arguments are values of classes, which check themselves.
OF_VALUES = {"theory.calibrate_factor", "theory.correlated_factor", "theory.local_maximum_fraction"}
WITHOUT_ARGUMENTS = {"windows.window_names"}
# A pulse may be detected surely or never.
CERTAIN = {"theory.binary_integration_probability"}
# An infinite bound states that nothing can be estimated: directions of equal sources, or -3000 dB.
INFINITE = {f"theory.crlb_{name}" for name in ("angle", "directions", "range", "velocity")}
INFINITE |= {"theory.decoupled_range_std_m", "theory.direction_std_rad"}
INFINITE |= {"theory.frequency_variance"}
# Arguments that are no use when empty; others give an empty result, as in NumPy.
REDUCED = {"samples", "power", "snapshots", "covariance", "amplitudes", "positions", "positions_m"}
REDUCED |= {"weights", "values", "counts"}


def load_function(name):
    namespace, _, function = name.partition(".")
    return getattr(getattr(dc, namespace), function)


def invalid_values(function, argument, valid):
    """Yield values that the argument must refuse."""
    yield "text"
    yield np.nan
    if argument in {"window", "kind", "sampling"}:
        return
    yield [1.0, [2.0, 3.0]]
    if argument in REDUCED:
        yield []
        yield np.full_like(valid, np.nan, dtype=float)
    elif "probability" in argument or argument in {"pfa", "confidence"}:
        yield from (-0.1, 1.5, *(() if function in CERTAIN else (0.0, 1.0)))
    elif isinstance(valid, int) and argument != "axis":
        yield from (-1, 2.5, True)
    elif isinstance(valid, float):
        yield [1.0, np.nan]
        # An unknown value has an infinite deviation, and a cell to leave out an infinite threshold.
        if "_std_" not in argument and argument != "threshold":
            yield np.inf


@pytest.mark.parametrize("name", VALID_ARGUMENTS)
def test_each_invalid_argument_is_named_in_one_error(name):
    function, valid_arguments = load_function(name), VALID_ARGUMENTS[name]
    function(**valid_arguments)

    wrong = []
    for argument, valid in valid_arguments.items():
        for value in invalid_values(name, argument, valid):
            try:
                function(**{**valid_arguments, argument: value})
                wrong.append(f"{argument}={value!r} is accepted")
            except dc.InvalidSetting as error:
                if not any(argument in mistake.setting for mistake in error.mistakes):
                    wrong.append(f"{argument}={value!r} is not named: {error}")
            except Exception as error:  # of another kind, and thus without the name
                wrong.append(f"{argument}={value!r}: {error!r}")

    assert wrong == []


def extreme_values(valid):
    """Return arrays of other shapes and magnitudes, and values of other types."""
    array = np.atleast_1d(valid)
    lost = array.astype(complex if np.iscomplexobj(array) else float)
    lost.flat[0] = np.nan
    return [
        *(np.empty(shape) for shape in ((0,), (0, 8), (3, 0))),
        *(np.ones(shape) for shape in ((), (1,), (1, 1), (5, 7), (2, 3, 4))),
        *(array * factor for factor in (0, -1, 1e-200, 1e-80, 1e-30, 1e30, 1e80, 1e200)),
        *(lost, array[None], array.T, array[:-1], np.concatenate([array, array])),
        *(1e-320, 1e-300, 1e300, np.inf, 10**30, -1, True, (), {}, {1}, len, [None]),
        *(np.array(["2020-01-01"], "M8[s]"), np.array([5], "m8[s]"), np.timedelta64(5, "ms")),
        *(np.array([None, 1.0]), ["text"]),
    ]


def is_any(predicate, result):
    """Return True if a number, or an element of an array or of a tuple of them, fulfils it."""
    if isinstance(result, Directions):  # standard errors may be unknown
        result = result.azimuth_rad, result.power
    return any(predicate(x).any() for x in (result if isinstance(result, tuple) else (result,)))


@nightly
@pytest.mark.parametrize("name", VALID_ARGUMENTS)
def test_extreme_argument_gives_numbers_or_one_error(name):
    function, valid_arguments = load_function(name), VALID_ARGUMENTS[name]
    wrong = []
    for argument, valid in valid_arguments.items():
        for value in extreme_values(valid) if isinstance(valid, Numbers) else ():
            try:
                with warnings.catch_warnings(action="error", category=RuntimeWarning):
                    result = function(**{**valid_arguments, argument: value})
                if is_any(np.isnan, result) or (name not in INFINITE and is_any(np.isinf, result)):
                    wrong.append(f"{argument}={value!r}: {result}")
            except dc.DechirpError as error:
                check_error_is_complete(error)
            except Exception as error:
                wrong.append(f"{argument}={value!r}: {error!r}")

    assert wrong == []


@pytest.mark.parametrize("kind", ["bartlett", "capon", "fft", "iterative-adaptive", "music"])
@pytest.mark.parametrize("exponent", [-90, 90])
def test_directions_do_not_depend_on_the_unit_of_snapshots(kind, exponent):
    rng = np.random.default_rng(3)
    snapshots = SNAPSHOTS + 0.1 * rng.standard_normal(SNAPSHOTS.shape)
    scaled = snapshots * 2.0**exponent
    noise, scaled_noise = 0.01, np.ldexp(0.01, 2 * exponent)

    expected = dc.angle.estimate_directions(snapshots, LINE, 1, kind, noise_power=noise)
    result = dc.angle.estimate_directions(scaled, LINE, 1, kind, noise_power=scaled_noise)
    np.testing.assert_array_equal(result.azimuth_rad, expected.azimuth_rad)
    np.testing.assert_array_equal(result.azimuth_std_rad, expected.azimuth_std_rad)
    np.testing.assert_array_equal(result.power, np.ldexp(expected.power, 2 * exponent))
    spectra = [
        dc.angle.direction_spectrum(x, LINE, [0.1, 0.2], kind=kind, noise_power=power)
        for x, power in ((snapshots, noise), (scaled, scaled_noise))
    ]
    scale = 1.0 if kind == "music" else 4.0**exponent
    np.testing.assert_array_equal(spectra[1], spectra[0] * scale)


def test_cases_cover_all_public_functions_on_plain_arrays():
    functions = {
        name: thing
        for namespace in ("angle", "cfar", "maps", "link_budget", "theory", "windows")
        for name in getattr(dc, namespace).__all__
        if inspect.isroutine(thing := getattr(getattr(dc, namespace), name))
    }
    skipped = {name.partition(".")[2] for name in OF_VALUES | WITHOUT_ARGUMENTS}
    covered = {name.partition(".")[2] for name in VALID_ARGUMENTS}

    assert covered | skipped == functions.keys()
    for name, arguments in VALID_ARGUMENTS.items():
        assert arguments.keys() <= inspect.signature(load_function(name)).parameters.keys() | {
            "noise_power"
        }


@pytest.mark.parametrize(
    "call",
    [
        dc.maps.range_doppler_map,
        dc.maps.range_spectrum,
        lambda a: dc.cfar.cfar_threshold(a, n_training=2, n_guard=1, pfa=1e-3),
        lambda a: dc.angle.fft(a[None], 0.5 * np.arange(16)),
        lambda a: dc.theory.albersheim(a / 20, 1e-6),
        lambda a: dc.maps.range_doppler_map([a, a]),
    ],
)
def test_masked_values_are_refused_and_unmasked_ones_accepted(call):
    values = np.ma.array(np.full((16, 16), 10.0))
    call(values)

    values[3, 4] = np.ma.masked
    with pytest.raises(dc.InvalidSetting, match=r"[12] masked values; .*filled\(0\)"):
        call(values)


class Tensor:
    """Array of another library that refuses its conversion, as PyTorch does."""

    shape, ndim, dtype = (16, 16), 2, np.dtype(float)

    def __init__(self, error_class, text):
        self.error_class, self.text = error_class, text

    def __array__(self, dtype=None, copy=None):
        raise self.error_class(self.text)


TENSORS = {
    "tensor with gradient": Tensor(RuntimeError, "Can't call numpy() on Tensor: use detach()"),
    "tensor on a device": Tensor(TypeError, "can't convert cuda:0 device type tensor: use cpu()"),
}


@pytest.mark.parametrize("kind", TENSORS)
@pytest.mark.parametrize(
    "call",
    [
        dc.maps.range_doppler_map,
        lambda a: dc.cfar.cfar_threshold(a, n_training=2, n_guard=1, pfa=1e-3),
        lambda a: dc.angle.fft(a, LINE),
        lambda a: dc.theory.albersheim(a, 1e-6),
        lambda a: dc.theory.cell_averaging_factor(a, n_training=16),
    ],
)
def test_tensor_that_numpy_cannot_read_is_refused_with_its_reason(call, kind):
    tensor = TENSORS[kind]
    with pytest.raises(
        dc.InvalidSetting, match="a Tensor: [Cc]an't c.*; expected .*detach"
    ) as caught:
        call(tensor)
    check_error_is_complete(caught.value)
    assert tensor.text in str(caught.value)


# Several settings may be valid without numbers; a complex amplitude is one.
COMPLEX = {"amplitudes", "covariance", "samples", "snapshots", "source_covariance", "weights"}
OTHER_THAN_NUMBERS = {
    "empty": np.empty(0),
    "empty rows": np.empty((0, 8)),
    "empty columns": np.empty((8, 0)),
    "NaN": np.nan,
    "text": ["text"],
    "ragged": [[1], [1, 2]],
    "mapping": {},
    "complex": 1j,
    **TENSORS,
}


@pytest.mark.parametrize("kind", nightly_except(4, OTHER_THAN_NUMBERS))
def test_every_argument_of_numbers_refuses_other_values_by_its_name(kind):
    wrong = []
    for name, valid_arguments in VALID_ARGUMENTS.items():
        for argument, valid in valid_arguments.items():
            if not isinstance(valid, Numbers) or (kind == "complex" and argument in COMPLEX):
                continue
            try:
                load_function(name)(**{**valid_arguments, argument: OTHER_THAN_NUMBERS[kind]})
                wrong.append(f"{name}({argument}): accepted")
            except dc.InvalidSetting as error:
                check_error_is_complete(error)
                if not any(argument in mistake.setting for mistake in error.mistakes):
                    wrong.append(f"{name}({argument}): {error}")

    assert wrong == []


@pytest.mark.parametrize("name", VALID_ARGUMENTS)
def test_result_without_axes_is_a_scalar(name):
    function, arguments = load_function(name), VALID_ARGUMENTS[name]

    result = function(**arguments)

    members = result if isinstance(result, tuple) else (result,)
    assert [x for x in members if isinstance(x, np.ndarray) and x.ndim == 0] == []
    number = next((key for key, x in arguments.items() if isinstance(x, float)), None)
    if isinstance(result, np.generic) and number:
        in_array = function(**arguments | {number: [arguments[number]]})
        assert in_array.shape == (1,)
        assert in_array[0] == result


def test_spectrum_in_one_direction_is_a_scalar():
    spectrum = dc.angle.direction_spectrum(SNAPSHOTS, LINE, 0.2)
    assert isinstance(spectrum, np.floating)
    assert spectrum == pytest.approx(1.0)  # power of an element, of a source there


def with_unit(kind, numbers):
    """Return numbers as a quantity, a list of one, or a duration."""
    if kind == "duration":
        return np.asarray(numbers).real.astype("m8[ns]")[()]
    quantity = pint.Quantity(numbers, "km")
    return quantity if kind == "quantity" else [quantity]


@pytest.mark.parametrize("kind", ["quantity", "list of quantities", "duration"])
def test_every_argument_of_numbers_refuses_units_by_its_name(kind):
    wrong = []
    for name, valid_arguments in VALID_ARGUMENTS.items():
        for argument, valid in valid_arguments.items():
            if not isinstance(valid, Numbers):
                continue
            try:
                load_function(name)(**{**valid_arguments, argument: with_unit(kind, valid)})
                wrong.append(f"{name}({argument}): accepted")
            except dc.InvalidSetting as error:
                check_error_is_complete(error)
                if not any(argument in mistake.setting for mistake in error.mistakes):
                    wrong.append(f"{name}({argument}): {error}")
            except Exception as error:
                wrong.append(f"{name}({argument}): {error!r}")

    assert wrong == []


@pytest.mark.parametrize(
    ("argument", "call"),
    [
        (
            "range_m",
            lambda unit: dc.link_budget.beat_frequency(unit(50.0), slope_hz_per_s=1e13),
        ),
        ("snr", lambda unit: dc.theory.detection_probability(unit(5.0), 1e-4)),
        ("samples", lambda unit: dc.maps.range_doppler_map(unit(np.ones((4, 8))))),
        ("positions", lambda unit: dc.angle.music(SNAPSHOTS, unit(LINE))),
    ],
)
@pytest.mark.parametrize("kind", ["quantity", "duration"])
def test_number_with_a_unit_is_converted_as_its_message_says(argument, call, kind):
    call(lambda numbers: numbers)

    with pytest.raises(dc.InvalidSetting, match="plain numbers in SI units") as info:
        call(lambda numbers: with_unit(kind, numbers))

    (mistake,) = info.value.mistakes
    assert mistake.setting == argument
    assert "q.to('m').magnitude" in mistake.fix
    assert "t / np.timedelta64(1, 's')" in mistake.fix


@pytest.mark.parametrize("unit", [pint.Quantity(5.0, "m**2"), np.timedelta64(1, "ns")])
def test_settings_refuse_numbers_with_units(unit):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.rcs_m2: .*(met|nanosecond)"):
        dc.Target(position_m=(10.0, 0.0, 0.0), rcs_m2=unit)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        *(
            (
                r"^factor: 1e\+308; .*at most 1e\+60",
                lambda function=function, options=options: function(
                    10.0, 1e308, **CELLS, **options
                ),
            )
            for function, options in (
                (dc.theory.cell_averaging_detection_probability, {}),
                (dc.theory.greatest_of_detection_probability, {}),
                (dc.theory.smallest_of_detection_probability, {}),
                (dc.theory.ordered_statistic_detection_probability, {"rank": 12}),
            )
        ),
        (
            "^n_summed: 2147483647; .* to 900000000",
            lambda: dc.theory.detection_probability(1.0, 1e-4, n_summed=2**31 - 1),
        ),
        (
            "^n_summed: 2147483647; .* to 900000000",
            lambda: dc.theory.required_snr(0.9, 1e-4, n_summed=2**31 - 1),
        ),
        (
            "^n_summed: 1000000000; .*Shnidman's formula.*required_snr",
            lambda: dc.theory.shnidman(0.9, 1e-6, n_summed=10**9, swerling=1),
        ),
        (
            "^false_alarm_probability: 1e-300 with 16 training cells",
            lambda: dc.theory.cell_averaging_required_snr(0.9, 1e-300, n_training=16),
        ),
        (
            "^n_training: 100 training and 100 guard cells",
            lambda: dc.cfar.cfar_threshold(
                POWER, np.array([100, 3], np.uint8), np.array([100, 1], np.uint8), 1e-3
            ),
        ),
        ("^n_training: None", lambda: dc.cfar.cfar_threshold(POWER, None, 1, 1e-3)),
        ("^n_guard: None", lambda: dc.cfar.cfar_threshold(POWER, 3, None, 1e-3)),
        ("^n_guard: None", lambda: dc.cfar.cfar_threshold(POWER[0], 3, None, 1e-3)),
        (
            "^pfa: .*expected one number between 0 and 1",
            lambda: dc.cfar.cfar_threshold(POWER, 3, 1, [1e-4, 1e-6]),
        ),
        (
            r"^window: \('kaiser', 1000000\.0\) \(weights that are not finite\)",
            lambda: dc.windows.window_weights(("kaiser", 1e6), 8),
        ),
        (
            r"^azimuth_rad: -60\.0; .*np\.radians",
            lambda: dc.angle.direction_spectrum(SNAPSHOTS, LINE, np.arange(-60, 61, 30)),
        ),
    ],
)
def test_number_out_of_bounds_is_named(message, call):
    with pytest.raises(dc.InvalidSetting, match=message):
        call()


WINDOW = {
    "range_covariance": np.eye(9),
    "velocity_covariance": np.eye(9),
    "guard_range": slice(3, 6),
    "guard_velocity": slice(3, 6),
    "cell_under_test": (4, 4),
}
NEIGHBOURS = {"in_range": (2 / 3, 1 / 6), "in_velocity": (2 / 3, 1 / 6)}  # of a Hann window


def calibrate(statistic=lambda power: power.mean(axis=-1), window=WINDOW, **options):
    window = dc.theory.CorrelatedWindow(**window)
    return dc.theory.calibrate_factor(1e-2, statistic, window, **options).value


@pytest.mark.parametrize("axis", ["range", "velocity"])
@pytest.mark.parametrize(
    "covariance",
    [
        *(None, "text", [], 1.0, np.nan * np.eye(9), -np.eye(9), 2 * np.eye(9), 1j * np.eye(9)),
        *(np.triu(np.ones((9, 9))), np.eye(9, dtype=bool), np.eye(9).astype(object)),
        *(np.ma.array(np.eye(9), mask=np.eye(9)), np.ones((9, 8)), np.eye(0)),
    ],
)
def test_matrix_that_is_no_covariance_of_cells_is_named(axis, covariance):
    with pytest.raises(dc.InvalidSetting, match=rf"CorrelatedWindow\.{axis}_covariance: ") as info:
        dc.theory.CorrelatedWindow(**WINDOW | {f"{axis}_covariance": covariance})
    check_error_is_complete(info.value)


@pytest.mark.parametrize(
    "convert", [np.longdouble, np.float32, np.float16, ">f8", int, complex, list, pd.DataFrame]
)
def test_covariance_of_any_numbers_gives_the_factor_of_doubles(convert):
    covariance = np.eye(9)
    converts = convert in (list, pd.DataFrame)
    window = WINDOW | {
        "range_covariance": convert(covariance) if converts else covariance.astype(convert)
    }
    expected = dc.theory.correlated_factor(1e-3, dc.theory.CorrelatedWindow(**WINDOW))
    factor = dc.theory.correlated_factor(1e-3, dc.theory.CorrelatedWindow(**window))
    assert factor == pytest.approx(expected, rel=1e-12)
    assert calibrate(window=window) == pytest.approx(calibrate(), rel=1e-6)


@pytest.mark.parametrize("position", [(4, 4, 4), (4,), None, 4, "44", (4, 9), (4.0, 4)])
def test_position_outside_the_guard_is_named(position):
    with pytest.raises(dc.InvalidSetting, match=r"CorrelatedWindow\.cell_under_test"):
        dc.theory.CorrelatedWindow(**WINDOW | {"cell_under_test": position})


def test_position_in_an_array_equals_that_in_a_tuple():
    window = dc.theory.CorrelatedWindow(**WINDOW | {"cell_under_test": np.array([4, 4], "u8")})
    assert window.cell_under_test == (4, 4)
    np.testing.assert_array_equal(window.covariance, np.eye(73))


@pytest.mark.parametrize("name", NEIGHBOURS)
@pytest.mark.parametrize(
    "lags",
    [
        *(None, 1.0, "text", (), (0.5,), (0.5, 0.1, 0.0), ("a", 0.0), (None, 0.0), (np.nan, 0.0)),
        *((np.inf, 0.0), (2.0, 0.0), (1.0, -1.0), {}, object()),
    ],
)
def test_correlations_that_no_noise_has_are_named(name, lags):
    with pytest.raises(dc.InvalidSetting, match=rf"NeighbourCorrelation\.{name}: ") as info:
        dc.theory.NeighbourCorrelation(**NEIGHBOURS | {name: lags})
    check_error_is_complete(info.value)


def test_correlations_in_a_list_or_array_equal_those_in_a_tuple():
    expected = dc.theory.NeighbourCorrelation(**NEIGHBOURS)
    for convert in (list, np.array):
        neighbours = dc.theory.NeighbourCorrelation(
            **{name: convert(lags) for name, lags in NEIGHBOURS.items()}
        )
        assert neighbours == expected
        assert dc.theory.local_maximum_fraction(1e-3, neighbours) == pytest.approx(
            dc.theory.local_maximum_fraction(1e-3, expected)
        )


@pytest.mark.parametrize(
    "statistic",
    [
        lambda _: None,
        lambda _: 1.0,
        len,
        lambda power: power,
        lambda power: np.nan * power.mean(axis=-1),
        lambda power: 0 * power.mean(axis=-1),
        lambda power: -power.mean(axis=-1),
        lambda _: [[1], [1, 2]],
        lambda power: np.ma.array(power.mean(axis=-1), mask=power[:, 0] > 1),
    ],
)
def test_statistic_without_a_positive_number_for_each_draw_is_named(statistic):
    with pytest.raises(dc.InvalidSetting, match=r"^statistic: a function that returns ") as info:
        calibrate(statistic)
    check_error_is_complete(info.value)


def test_statistic_may_return_a_list():
    assert calibrate(lambda power: power.mean(axis=-1).tolist()) == pytest.approx(calibrate())


@pytest.mark.parametrize(
    "masks",
    [
        np.zeros((1, 72), bool),
        np.ones(72, bool),
        np.ones((1, 70), bool),
        np.ones((1, 72), int),
        np.ones((0, 72), bool),
        np.array(True),
    ],
)
def test_masks_of_other_cells_are_named(masks):
    with pytest.raises(dc.InvalidSetting, match=r"^low_cell_masks: an array ") as info:
        calibrate(low_cell_masks=masks)
    check_error_is_complete(info.value)


def test_covariance_with_a_negative_eigenvalue_is_named():
    # The first three cells contradict each other: eigenvalues 1.9, 1.9 and -0.8.
    covariance = np.eye(9)
    covariance[:3, :3] = [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]
    with pytest.raises(dc.InvalidSetting, match="^window: a covariance with a negative eigenvalue"):
        calibrate(window=WINDOW | {"range_covariance": covariance})


def test_sum_of_powers_beyond_the_memory_is_named():
    neighbours = dc.theory.NeighbourCorrelation(**NEIGHBOURS)
    with pytest.raises(dc.NotEnoughMemory, match="^n_summed=1000000000: "):
        dc.theory.local_maximum_fraction(1e-3, neighbours, n_summed=10**9)
    with pytest.raises(dc.NotEnoughMemory, match="^n_summed=10000000 of 72 training cells: "):
        calibrate(n_summed=10**7)


@pytest.mark.parametrize(
    ("function", "cells"),
    [
        (dc.theory.trimmed_mean_factor, {"n_smallest": 2, "n_largest": 4}),
        (dc.theory.ordered_statistic_factor, {"rank": 10**9}),
    ],
)
def test_training_cells_beyond_the_memory_are_named(function, cells, monkeypatch):
    monkeypatch.setattr("dechirp.core.memory.available_memory_bytes", lambda: 2.0**34)
    with pytest.raises(dc.NotEnoughMemory, match="^n_training=1000000000: "):
        function(1e-6, n_training=10**9, **cells)


@pytest.mark.parametrize("kind", ["greatest", "smallest"])
def test_factor_of_halves_beyond_the_largest_is_named_by_its_probability(kind):
    # Of a half of one cell, the factor is about 1 / Pfa or the square root of it: above 1e60.
    factor = getattr(dc.theory, f"{kind}_of_factor")
    with pytest.raises(dc.InvalidSetting, match="^false_alarm_probability: 1e-300") as info:
        factor(1e-300, n_training=2)
    check_error_is_complete(info.value)


@pytest.mark.parametrize(
    "create", [dc.angle.Capon, dc.angle.Music, dc.angle.RootMusic, dc.angle.Esprit]
)
@pytest.mark.parametrize("smoothing", [0.5, 6, None, [0.5], {"share": 0.5}])
def test_smoothing_of_another_class_is_named(create, smoothing):
    with pytest.raises(dc.InvalidSetting, match=rf"^{create.__name__}\.smoothing: ") as info:
        create(smoothing=smoothing)
    check_error_is_complete(info.value)


@pytest.mark.parametrize("name", ["n_smallest", "n_largest"])
def test_trimmed_cells_beyond_any_window_are_named(name):
    for number in (1e308, 10**30):
        with pytest.raises(dc.InvalidSetting, match=rf"^TrimmedMean\.{name}: "):
            dc.cfar.TrimmedMean(**{name: number})


def test_number_of_sources_of_a_kind_is_not_dropped():
    for function, others in (
        (dc.angle.estimate_directions, {}),
        (dc.angle.direction_spectrum, {"azimuth_rad": 0.1}),
    ):
        kind = dc.angle.Music(n_sources=2)
        with pytest.raises(dc.InvalidSetting, match="^n_sources: 1; expected 2, as in kind"):
            function(SNAPSHOTS, LINE, kind=kind, **others)
        function(SNAPSHOTS, LINE, n_sources=2, kind=kind, **others)


def with_memory(monkeypatch, n_bytes):
    monkeypatch.setattr("dechirp.core.memory.available_memory_bytes", lambda: n_bytes)


@pytest.mark.parametrize(
    ("function", "arguments", "name"),
    [
        (dc.windows.window_weights, {"window": "hann", "n": 10**9}, "n=1000000000"),
        (dc.windows.chebyshev_weights, {"n": 10**9, "sidelobe_db": 60.0}, "n=1000000000"),
        (dc.windows.taylor_weights, {"n": 10**8, "n_bar": 100, "sidelobe_db": 30.0}, "n=100000000"),
        (dc.windows.kaiser_weights, {"n": 10**9, "beta": 6.0}, "n=1000000000"),
        (dc.windows.bin_correlation, {**WEIGHTS, "n_bins": 10**9, "lags": 1}, "n_bins=1000000000"),
        (
            dc.angle.snapshots_from_covariance,
            {"covariance": np.eye(3), "n_snapshots": 10**9},
            "n_snapshots=1000000000",
        ),
        (
            dc.angle.direction_spectrum,
            {"snapshots": SNAPSHOTS, "positions": LINE, "azimuth_rad": np.zeros(10**6)},
            "the spectrum over 1000000 directions",
        ),
        (
            dc.cfar.cfar_threshold,
            {"power": np.ones((30, 10**5)), "n_training": 3, "n_guard": 1, "pfa": 1e-3},
            "thresholds of 3000000 cells",
        ),
        (
            dc.cfar.find_peaks,
            {"power": np.broadcast_to(1.0, (100, 10**5)), "threshold": 2.0},
            "power",
        ),
    ],
)
def test_argument_beyond_the_memory_is_named(function, arguments, name, monkeypatch):
    with_memory(monkeypatch, 2.0**26)
    with pytest.raises(dc.NotEnoughMemory, match=name) as info:
        function(**arguments)
    check_error_is_complete(info.value)


@pytest.mark.parametrize(
    "window",
    [
        ("general_cosine", []),
        ("general_cosine", [0.5, [0.5]]),
        ("general_cosine", np.ones((2, 2))),
        ("general_cosine", np.ma.array([0.5, 0.5], mask=[True, False])),
        ("kaiser", {"beta": 6.0}),
        xr.DataArray(6.0),
        pint.Quantity(6.0, "m"),
    ],
)
def test_window_of_no_list_of_numbers_is_named(window):
    for function, others in (
        (dc.windows.window_weights, {"n": 8}),
        (dc.windows.half_main_lobe_bins, {}),
        (dc.maps.range_doppler_map, {"samples": np.ones((8, 8))}),
        (dc.cfar.cfar_threshold, {"power": POWER, "n_training": 3, "n_guard": 1, "pfa": 1e-3}),
    ):
        with pytest.raises(dc.InvalidSetting, match="^window: ") as info:
            function(window=window, **others)
        check_error_is_complete(info.value)


@pytest.mark.parametrize("axis", [True, (False, True)])
def test_axis_of_truth_values_is_named(axis):
    with pytest.raises(dc.InvalidSetting, match="^axis: "):
        dc.cfar.cfar_threshold(POWER, 3, 1, 1e-3, axis=axis)


@pytest.mark.parametrize("elevation_deg", [91.0, -91.0])
def test_elevation_in_degrees_or_behind_the_zenith_is_named(elevation_deg):
    for elevation in (elevation_deg, np.radians(elevation_deg)):
        with pytest.raises(dc.InvalidSetting, match="^elevation_rad: "):
            dc.angle.direction_spectrum(SNAPSHOTS, LINE, 0.1, elevation)
    zenith = dc.angle.direction_spectrum(SNAPSHOTS, LINE, 0.1, np.float32(np.pi / 2))
    np.testing.assert_allclose(zenith, dc.angle.direction_spectrum(SNAPSHOTS, LINE, 0.0), rtol=1e-5)


@pytest.mark.parametrize(("pfa", "power"), [(1e-300, POWER[0]), (1e-3, np.full(30, 1.7e308))])
def test_threshold_beyond_floating_point_is_named(pfa, power):
    # Of N cells, the factor N (pfa^(-1/N) - 1) exceeds single precision: N = 6 gives 6e50.
    with (
        warnings.catch_warnings(action="error"),
        pytest.raises(dc.InvalidSetting, match="^pfa and power: ") as info,
    ):
        dc.cfar.cfar_threshold(power, 3, 1, pfa)
    check_error_is_complete(info.value)


def test_unresolvable_sources_without_noise_raise_no_warning():
    # Seven beams in three snapshots coincide: an infinite bound times no noise has no value.
    rng = np.random.default_rng(1)
    snapshots = SNAPSHOTS + 0.01 * rng.standard_normal(SNAPSHOTS.shape)
    with warnings.catch_warnings(action="error", category=RuntimeWarning):
        result = dc.angle.bartlett(snapshots, LINE, 7)
    assert np.isnan(result.azimuth_std_rad).all()


@nightly
def test_iterative_adaptive_with_coincident_elements_and_a_large_grid_finds_the_source():
    # Seven elements at one place: their covariance has rank one up to its rounding errors.
    positions = np.r_[np.zeros(7), 2e4]
    snapshots = np.exp(-2j * np.pi * positions * np.sin(0.2)) * np.ones((3, 1))
    result = dc.angle.iterative_adaptive(snapshots, positions)
    # Beams 2e4 wavelengths apart repeat each 5e-5 of the sine.
    ambiguities = (np.sin(result.azimuth_rad) - np.sin(0.2)) * 2e4
    np.testing.assert_allclose(ambiguities, np.round(ambiguities), rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    "wrap",
    [
        xr.DataArray,
        np.ma.array,
        lambda number: np.array(number, object),
        lambda number: np.asarray(number, ">f8" if isinstance(number, float) else ">i4"),
    ],
)
def test_number_in_an_array_without_axes_equals_that_number(wrap):
    for function, arguments in (
        (dc.theory.cell_averaging_factor, {"false_alarm_probability": 1e-6, "n_training": 16}),
        (dc.theory.required_snr, {"detection_probability": 0.9, "false_alarm_probability": 1e-6}),
        (dc.theory.detection_threshold, {"false_alarm_probability": 1e-6, "n_summed": 2}),
    ):
        expected = function(**arguments)
        for name, number in arguments.items():
            result = function(**arguments | {name: wrap(number)})
            assert result == expected
            assert not isinstance(result, np.ndarray)


def test_masked_number_is_no_zero():
    for name, create in (
        ("n_smallest", dc.cfar.TrimmedMean),
        ("channel_phase_rad", dc.angle.MaximumLikelihood),
        ("n_training", partial(dc.theory.cell_averaging_factor, 1e-6)),
    ):
        with pytest.raises(dc.InvalidSetting, match=name):
            create(**{name: np.ma.masked})
