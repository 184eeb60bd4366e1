"""Published formulas, evaluated elsewhere to 40 digits, against what the package computes.

`theory_public.json` holds one case for each formula, with its source and tolerance. The
table says which function answers which quantity, and for which inputs where it answers only
some. What is not in the table, the package does not compute yet.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from dechirp.core.units import decibels, from_decibels
from dechirp.radar.array import Array
from dechirp.radar.budget import received_power_w, snr
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.theory import bounds, detection
from dechirp.theory.cfar import Box, independent_factor
from dechirp.theory.windows import coherent_gain, noise_bandwidth_bins, scalloping_loss, taper

CASES = json.loads((Path(__file__).parent / "theory_public.json").read_text())["cases"]


def threshold(case):
    return detection.threshold(case["pfa"])


def detection_probability(case):
    return detection.detection_probability(from_decibels(case["snr_db"]), case["pfa"])


def required_snr_db(case):
    return decibels(detection.required_snr(case["pd"], case["pfa"]))


def factor(case):
    return independent_factor(case["pfa"], n_training=case["n_train"])


def factor_of_summed_channels(case):
    channels = case["n_channels_summed"]
    return independent_factor(case["pfa"], n_training=case["n_train"], n_channels=channels)


def training_cells(case):
    range_, velocity = (case[f"train_{axis}"] for axis in ("range", "doppler"))
    guard_range, guard_velocity = (case[f"guard_{axis}"] for axis in ("range", "doppler"))
    box = Box(
        range_covariance=np.eye(2 * (range_ + guard_range) + 1),
        velocity_covariance=np.eye(2 * (velocity + guard_velocity) + 1),
        guard_range=slice(range_, range_ + 2 * guard_range + 1),
        guard_velocity=slice(velocity, velocity + 2 * guard_velocity + 1),
        under_test=(range_ + guard_range, velocity + guard_velocity),
    )
    return box.n_training


def integrated_snr(case):
    return from_decibels(case["snr_per_sample_db"]) * case["n_samples"] * case["n_chirps"]


def range_bound(case):
    return bounds.range_std_m(
        snr=integrated_snr(case),
        n_samples=case["n_samples"],
        sample_rate_hz=case["fs_hz"],
        slope_hz_per_s=case["slope_hz_per_s"],
    )


def velocity_bound(case):
    return bounds.velocity_std_m_per_s(
        snr=integrated_snr(case),
        n_chirps=case["n_chirps"],
        interval_s=case["chirp_interval_s"],
        wavelength_m=299_792_458.0 / case["f_carrier_hz"],
    )


def radar(case):
    """Radar of a case; the frequency that the case gives is that of mid-window."""
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
    return decibels(received_power_w(radar(case), **target(case))) + 30


def sample_snr_db(case):
    return decibels(snr(radar(case), **target(case)))


def integrated_snr_db(case):
    made = radar(case)
    return decibels(snr(made, **target(case)) * made.integration_gain)


def integration_gain_db(case):
    filled = {"fc_hz": 77e9, "pt_dbm": 0, "gt_dbi": 0, "loss_db": 0} | case
    return decibels(radar(filled).integration_gain)


def window(case):
    return taper("hann", case["n"])


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
    # Transmitters that take turns: each comes again after n_tx chirps.
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


ONE_PULSE = {"n_pulses": 1}
STEADY = {"n_pulses": 1, "swerling": 0}

COMPUTED = {
    "threshold_square_law_normalised": (threshold, ONE_PULSE),
    "pd_noncoherent": (detection_probability, STEADY),
    "required_snr_exact_db": (required_snr_db, STEADY),
    "ca_cfar_multiplier": (factor, {}),
    "ca_cfar_multiplier_nci": (factor_of_summed_channels, {}),
    "cfar_2d_training_count": (training_cells, {}),
    "range_crlb_std_m": (range_bound, {}),
    "velocity_crlb_std_mps": (velocity_bound, {}),
    "received_power_dbm": (received_power_dbm, {}),
    "adc_sample_snr_db": (sample_snr_db, {}),
    "post_fft_snr_db": (integrated_snr_db, {}),
    "processing_gain_db": (integration_gain_db, {}),
    "coherent_gain": (lambda case: coherent_gain(window(case)), {}),
    "enbw_bins": (lambda case: noise_bandwidth_bins(window(case)), {}),
    "scalloping_loss_db": (lambda case: decibels(scalloping_loss(window(case))), {}),
    "sampled_bandwidth_hz": (lambda case: frame(case).chirp.sampled_bandwidth_hz, {}),
    "range_resolution_m": (lambda case: frame(case).chirp.range_resolution_m, {}),
    "max_range_complex_m": (lambda case: frame(case).chirp.max_range_m, {}),
    "max_velocity_mps": (lambda case: frame(case).max_velocity_m_per_s, {}),
    "velocity_resolution_mps": (lambda case: frame(case).velocity_resolution_m_per_s, {}),
    "range_doppler_coupling_m": (coupling_m, {}),
}


def is_computed(case):
    _, only = COMPUTED.get(case["quantity"], (None, None))
    return only is not None and only.items() <= case["inputs"].items()


@pytest.mark.parametrize("case", list(filter(is_computed, CASES)), ids=lambda case: case["id"])
def test_a_published_formula_gives_its_number(case):
    compute, _ = COMPUTED[case["quantity"]]

    expected = (
        pytest.approx(case["expected"], rel=0, abs=case["tol_abs"])
        if "tol_abs" in case
        else pytest.approx(case["expected"], rel=case["tol_rel"], abs=0)
    )
    assert float(compute(case["inputs"])) == expected


def test_every_function_of_the_table_meets_a_case():
    assert set(COMPUTED) <= {case["quantity"] for case in CASES if is_computed(case)}
