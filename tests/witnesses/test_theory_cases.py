"""Published formulas, evaluated independently to 40 digits, against the package.

`theory_public.json` contains one case for each formula, with its source and tolerance. The table
FUNCTIONS maps quantities to functions. The package does not compute quantities outside the table.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from dechirp.core.units import from_decibels, to_decibels
from dechirp.radar.array import Array
from dechirp.radar.budget import received_power_w, sample_snr
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.simulation.kernels import direct
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.theory import (
    bounds,
    cfar,
    cfar_detection,
    confidence_intervals,
    detection,
    snr_approximations,
)
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow
from dechirp.theory.windows import (
    coherent_gain,
    noise_bandwidth_bins,
    scalloping_loss,
    window_weights,
)

CASES = json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]


def threshold(case):
    return detection.detection_threshold(case["pfa"], n_summed=case["n_pulses"])


def sums(case):
    return {"n_summed": case["n_pulses"], "swerling": case["swerling"]}


def detection_probability(case):
    ratio = from_decibels(case["snr_db"])
    return detection.detection_probability(ratio, case["pfa"], **sums(case))


def required_snr_db(case):
    return to_decibels(detection.required_snr(case["pd"], case["pfa"], **sums(case)))


def coherent_snr_db(case):
    return to_decibels(detection.coherent_required_snr(case["pd"], case["pfa"]))


def albersheim_db(case):
    snr = snr_approximations.albersheim(case["pd"], case["pfa"], n_summed=case["n_pulses"])
    return to_decibels(snr)


def shnidman_db(case):
    return to_decibels(snr_approximations.shnidman(case["pd"], case["pfa"], **sums(case)))


def factor(case):
    return cfar.cell_averaging_factor(case["pfa"], n_training=case["n_train"])


def factor_of_summed_channels(case):
    channels = case["n_channels_summed"]
    return cfar.cell_averaging_factor(case["pfa"], n_training=case["n_train"], n_summed=channels)


def ordered_statistic_factor(case):
    return cfar.ordered_statistic_factor(case["pfa"], n_training=case["n_train"], rank=case["k"])


def greatest_of_factor(case):
    return cfar.greatest_of_factor(case["pfa"], n_training=case["n_train"])


def smallest_of_factor(case):
    return cfar.smallest_of_factor(case["pfa"], n_training=case["n_train"])


def cell_averaging_probability(swerling):
    def compute(case):
        return cfar_detection.cell_averaging_detection_probability(
            from_decibels(case["snr_db"]),
            factor(case),
            n_training=case["n_train"],
            swerling=swerling,
        )

    return compute


def cell_averaging_loss_db(swerling):
    def compute(case):
        return to_decibels(
            cfar_detection.cell_averaging_loss(
                case["pd"], case["pfa"], n_training=case["n_train"], swerling=swerling
            )
        )

    return compute


def ordered_statistic_probability(case):
    return cfar_detection.ordered_statistic_detection_probability(
        from_decibels(case["snr_db"]),
        ordered_statistic_factor(case),
        n_training=case["n_train"],
        rank=case["k"],
        swerling=1,
    )


def training_cells(case):
    range_, velocity = (case[f"train_{axis}"] for axis in ("range", "doppler"))
    guard_range, guard_velocity = (case[f"guard_{axis}"] for axis in ("range", "doppler"))
    window = CorrelatedWindow(
        range_covariance=np.eye(2 * (range_ + guard_range) + 1),
        velocity_covariance=np.eye(2 * (velocity + guard_velocity) + 1),
        guard_range=slice(range_, range_ + 2 * guard_range + 1),
        guard_velocity=slice(velocity, velocity + 2 * guard_velocity + 1),
        cell_under_test=(range_ + guard_range, velocity + guard_velocity),
    )
    return window.n_training


def integrated_snr(case):
    return from_decibels(case["snr_per_sample_db"]) * case["n_samples"] * case["n_chirps"]


def range_bound(case):
    return bounds.crlb_range(
        snr=integrated_snr(case),
        n_samples=case["n_samples"],
        sample_rate_hz=case["fs_hz"],
        slope_hz_per_s=case["slope_hz_per_s"],
    )


def velocity_bound(case):
    return bounds.crlb_velocity(
        snr=integrated_snr(case),
        n_chirps=case["n_chirps"],
        interval_s=case["chirp_interval_s"],
        wavelength_m=299_792_458.0 / case["f_carrier_hz"],
    )


def angle_bound_deg(case):
    positions_m = np.arange(case["n_elements"]) * case["spacing_wavelengths"]
    return np.degrees(
        bounds.crlb_angle(
            snr=from_decibels(case["snr_per_element_db"]),
            positions_m=positions_m,
            wavelength_m=1.0,
            angle_rad=np.radians(case["angle_deg"]),
        )
    )


def upper_limit(case):
    _, high = confidence_intervals.binomial_interval(
        case["successes"], case["trials"], confidence=0.95
    )
    return high


def radar(case):
    """Make the radar of a case; the frequency of the case is that of mid-window."""
    n_samples, sample_rate_hz = case.get("n_samples", 256), case.get("fs_hz", 10e6)
    slope, duration_s = 10e12, n_samples / sample_rate_hz
    chirp = Chirp(
        start_frequency_hz=case["fc_hz"] - slope * duration_s / 2,
        slope_hz_per_s=slope,
        ramp_duration_s=duration_s,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling="complex",
    )
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=case.get("n_chirps", 64), interval_s=duration_s),
        array=Array(rx_m=[(0.0, 0.002 * i, 0.0) for i in range(case.get("n_virtual", 1))]),
        hardware=Hardware(
            transmit_power_w=from_decibels(case["pt_dbm"] - 30),
            antenna_gain=from_decibels(case["gt_dbi"]),
            noise_factor=from_decibels(case.get("nf_db", 0.0)),
            loss=from_decibels(case["loss_db"]),
        ),
    )


def target(case):
    return {"range_m": case["range_m"], "rcs_m2": from_decibels(case["rcs_dbsm"])}


def received_power_dbm(case):
    return to_decibels(received_power_w(radar(case), **target(case))) + 30


def sample_snr_db(case):
    return to_decibels(sample_snr(radar(case), **target(case)))


def integrated_snr_db(case):
    case_radar = radar(case)
    return to_decibels(sample_snr(case_radar, **target(case)) * case_radar.integration_gain)


def integration_gain_db(case):
    complete_case = {"fc_hz": 77e9, "pt_dbm": 0, "gt_dbi": 0, "loss_db": 0} | case
    return to_decibels(radar(complete_case).integration_gain)


def window(case):
    return window_weights("hann", case["n"])


def frame(case):
    chirp = Chirp(
        start_frequency_hz=case["f_start_hz"],
        slope_hz_per_s=case["slope_hz_per_s"],
        adc_start_s=case["adc_start_s"],
        ramp_duration_s=case["ramp_end_s"],
        sample_rate_hz=case["fs_hz"],
        n_samples=case["n_samples"],
        sampling="complex",
    )
    # TDM: each transmitter repeats after n_tx chirps.
    interval_s = case["n_tx_tdm"] * (case["idle_s"] + case["ramp_end_s"])
    return Frame(chirp=chirp, n_chirps=case["n_loops"], interval_s=interval_s)


def coupling_m(case):
    slope, duration_s = case["slope_hz_per_s"], 25.6e-6
    chirp = Chirp(
        start_frequency_hz=case["f_carrier_hz"] - slope * duration_s / 2,
        slope_hz_per_s=slope,
        ramp_duration_s=duration_s,
        sample_rate_hz=10e6,
        n_samples=256,
        sampling="complex",
    )
    return chirp.range_doppler_coupling_m(case["velocity_mps_receding"])


def beat_phase_cycles(case):
    samples = np.zeros((case["chirp_index"] + 1, 1, case["sample_index"] + 1), complex)
    antenna_m, range_m = np.zeros((1, 3)), case["range0_m"]
    path_m = np.array([[[range_m, 0.0, 0.0]], [[case["velocity_mps_receding"], 0.0, 0.0]]])
    direct.add_echoes(
        samples,
        Scatterers(path_m, np.ones(1), np.ones((1, 1)), np.ones((1, 1))),
        Transmission(
            starts_s=case["chirp_interval_s"] * np.arange(len(samples)),
            weights=np.ones((len(samples), 1), complex),
            tx_m=antenna_m,
            rx_m=antenna_m,
            start_frequency_hz=case["f_start_hz"],
            slope_hz_per_s=case["slope_hz_per_s"],
            adc_start_s=0.0,
            sample_rate_hz=case["fs_hz"],
        ),
    )
    return np.angle(samples[-1, 0, -1]) / (2 * np.pi) % 1


FUNCTIONS = {
    "beat_phase_cycles_mod1": beat_phase_cycles,
    "threshold_square_law_normalised": threshold,
    "pd_noncoherent": detection_probability,
    "required_snr_exact_db": required_snr_db,
    "required_snr_coherent_known_phase_db": coherent_snr_db,
    "albersheim_db": albersheim_db,
    "shnidman_db": shnidman_db,
    "ca_cfar_multiplier": factor,
    "ca_cfar_multiplier_nci": factor_of_summed_channels,
    "os_cfar_multiplier": ordered_statistic_factor,
    "goca_multiplier": greatest_of_factor,
    "soca_multiplier": smallest_of_factor,
    "ca_cfar_pd_swerling0": cell_averaging_probability(0),
    "ca_cfar_pd_swerling1": cell_averaging_probability(1),
    "ca_cfar_loss_swerling0_db": cell_averaging_loss_db(0),
    "ca_cfar_loss_swerling1_db": cell_averaging_loss_db(1),
    "os_cfar_pd_swerling1": ordered_statistic_probability,
    "cfar_2d_training_count": training_cells,
    "range_crlb_std_m": range_bound,
    "velocity_crlb_std_mps": velocity_bound,
    "angle_crlb_std_deg": angle_bound_deg,
    "clopper_pearson_upper95": upper_limit,
    "received_power_dbm": received_power_dbm,
    "adc_sample_snr_db": sample_snr_db,
    "post_fft_snr_db": integrated_snr_db,
    "processing_gain_db": integration_gain_db,
    "coherent_gain": lambda case: coherent_gain(window(case)),
    "enbw_bins": lambda case: noise_bandwidth_bins(window(case)),
    "scalloping_loss_db": lambda case: to_decibels(scalloping_loss(window(case))),
    "sampled_bandwidth_hz": lambda case: frame(case).chirp.sampled_bandwidth_hz,
    "range_resolution_m": lambda case: frame(case).chirp.range_resolution_m,
    "max_range_complex_m": lambda case: frame(case).chirp.max_range_m,
    "max_velocity_mps": lambda case: frame(case).max_velocity_m_per_s,
    "velocity_resolution_mps": lambda case: frame(case).velocity_resolution_m_per_s,
    "range_doppler_coupling_m": coupling_m,
}


def is_computed(case):
    return case["quantity"] in FUNCTIONS


@pytest.mark.parametrize("case", list(filter(is_computed, CASES)), ids=lambda case: case["id"])
def test_published_formula_gives_its_value(case):
    compute = FUNCTIONS[case["quantity"]]

    expected = (
        pytest.approx(case["expected"], rel=0, abs=case["tol_abs"])
        if "tol_abs" in case
        else pytest.approx(case["expected"], rel=case["tol_rel"], abs=0)
    )
    assert float(compute(case["inputs"])) == expected


def test_every_function_of_table_has_case():
    assert set(FUNCTIONS) <= {case["quantity"] for case in CASES}
