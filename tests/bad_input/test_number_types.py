"""Numbers of NumPy, and arrays in place of numbers: results as with numbers of Python."""

from functools import partial

import numpy as np
import pytest

import dechirp as dc
from bad_input.test_array_arguments import VALID_ARGUMENTS, load_function
from dechirp.processing.angle.base import Directions
from radars import street_radar

# Single numbers: of one result for all values, of one scene, or of the design of a window.
SINGLE = {
    *("theory.mean_interval.confidence", "theory.rms_interval.confidence"),
    *("theory.rate_interval.confidence", "theory.rate_interval.exposure"),
    *("theory.crlb_directions.noise_power", "theory.crlb_directions.n_snapshots"),
    *("theory.direction_std_rad.elevation_rad", "theory.direction_std_rad.noise_power"),
    "theory.sphere_rcs_m2.wavelength_m",
}
NUMBERS = [
    (name, argument)
    for name, arguments in VALID_ARGUMENTS.items()
    for argument, value in arguments.items()
    if type(value) in (int, float) and argument != "axis"
]


def to_arrays(result):
    if isinstance(result, Directions):
        result = result.azimuth_rad, result.power
    return np.asarray(result)


@pytest.mark.parametrize(("name", "argument"), NUMBERS)
def test_number_of_numpy_equals_that_of_python(name, argument):
    function, arguments = load_function(name), VALID_ARGUMENTS[name]
    value = arguments[argument]
    types = (
        [np.int8, np.uint16, np.int64] if isinstance(value, int) else [np.float64, np.longdouble]
    )
    for number in (*(convert(value) for convert in types), np.array(value)):
        result = function(**{**arguments, argument: number})
        np.testing.assert_array_equal(to_arrays(result), to_arrays(function(**arguments)))


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        (name, argument)
        for name, argument in NUMBERS
        if name.startswith(("theory.", "link_budget.")) and f"{name}.{argument}" not in SINGLE
    ],
)
def test_array_in_place_of_a_number_gives_each_element(name, argument):
    function, arguments = load_function(name), VALID_ARGUMENTS[name]
    value = arguments[argument]
    larger = 2 * value if argument in {"n_training", "n", "trials"} else value
    expected = (
        to_arrays(function(**arguments)),
        to_arrays(function(**{**arguments, argument: larger})),
    )
    for pair in ([value, larger], np.array([[value], [larger]])):
        result = to_arrays(function(**{**arguments, argument: pair}))
        elements = result.reshape(*expected[0].shape, 2)
        np.testing.assert_allclose(elements[..., 0], expected[0], rtol=1e-14)
        np.testing.assert_allclose(elements[..., 1], expected[1], rtol=1e-14)


@pytest.mark.parametrize("convert", [np.int8, np.uint8, np.int16])
def test_narrow_counts_do_not_overflow(convert):
    count = convert(100)
    power = np.random.default_rng(1).exponential(size=(4, 300))
    calls = [
        lambda n: dc.theory.cell_averaging_factor(1e-6, n_training=n, n_summed=n),
        lambda n: dc.theory.cell_averaging_loss(0.9, 1e-6, n_training=n, n_summed=4),
        lambda n: dc.theory.greatest_of_factor(1e-6, n_training=(n, n), n_summed=n),
        lambda n: dc.cfar.cfar_threshold(power, n, 2, 1e-3, axis=1),
        lambda n: dc.maps.range_doppler_map(np.ones((100, 100)), n_bins=(n, n)),
        lambda n: dc.windows.taylor_weights(n, 4, 30),
    ]
    for call in calls:
        np.testing.assert_array_equal(call(count), call(100))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_summed": [1, 2.5]}, r"^n_summed: 1.0; expected a whole number"),
        ({"n_summed": [True]}, r"^n_summed: \[True\]; expected a whole number"),
        ({"false_alarm_probability": [1e-3, 2]}, r"^false_alarm_probability: 2.0; expected betw"),
        (
            {"false_alarm_probability": np.ma.array([1e-3, 1e-4], mask=[True, False])},
            r"^false_alarm_probability: 1 masked values",
        ),
        (
            {"false_alarm_probability": [1e-3, 1e-4], "n_summed": [1, 2, 3]},
            r"^false_alarm_probability and n_summed: arrays .* \(2,\), n_summed \(3,\)",
        ),
        ({"pfa": 1e-3}, r"^detection_threshold.pfa: unknown argument; expected one of false_alarm"),
    ],
)
def test_wrong_element_is_named(arguments, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        dc.theory.detection_threshold(**{"false_alarm_probability": 1e-3, **arguments})


def test_empty_array_is_named():
    with pytest.raises(dc.InvalidSetting, match=r"^false_alarm_probability: an empty array \(0,\)"):
        dc.theory.detection_threshold([], n_summed=[[1], [2]])


RADAR = street_radar(n_samples=64, n_chirps=32)
STREET = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(1, 0, 0))])


@pytest.mark.parametrize("scale", [1e-200, 1e-38, 1e60, 1e200])
@pytest.mark.parametrize(
    "call",
    [
        dc.detect,
        dc.power_map,
        lambda cube, radar: dc.power_map(
            cube, radar, dc.Chain(mitigation=(dc.mitigation.MeanSubtraction(),))
        ),
        dc.spectrogram,
        partial(dc.slow_time.slow_time, range_m=10.0),
    ],
)
def test_samples_beyond_single_precision_are_refused(call, scale):
    """The detections of such samples would be none, without a warning."""
    cube = dc.simulate(STREET, RADAR, seed=1).astype(complex)
    call(cube, RADAR)
    with pytest.raises(dc.InvalidSetting, match=r"samples of up to .*single precision.*divide"):
        call(cube * scale / float(abs(cube).max()), RADAR)
