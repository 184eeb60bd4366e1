"""Link budget of a scenario, from the transmitter to the margin over the threshold."""

from pathlib import Path

import numpy as np

from dechirp.core.disk_cache import read_cached_numbers, source_hash, write_cached_numbers
from dechirp.core.units import to_decibels
from dechirp.evaluation.predicted_detection import nearest_cell_snr_fraction
from dechirp.experiments.scenario import Scenario
from dechirp.radar.budget import BudgetLine, received_power_w
from dechirp.radar.patterns.base import Pattern
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.truth import truth
from dechirp.simulation.stages import sort_into_stages
from dechirp.theory import detection, swerling

DETECTION_PROBABILITY = 0.9


def added_noise_power_w(scenario: Scenario, radar: Radar) -> float:
    """Return the power of the noise that the impairments add to each sample, W."""
    assert scenario.scene is not None
    impairments = sort_into_stages(scenario.impairments, radar).impairments
    return sum(impairment.noise_power_w(scenario.scene, radar) for impairment in impairments)


def link_budget_of_first_target(scenario: Scenario, radar: Radar) -> tuple[BudgetLine, ...] | None:
    """Compute powers and gains of the first target's echo, in the middle of the first frame.

    The last line is the margin over the SNR that a steady target needs in known noise for a
    detection probability of 0.9. None without a target, or outside the antenna patterns.
    """
    if scenario.scene is None or not scenario.scene.targets:
        return None
    hardware = radar.require_hardware()
    first_truth = truth(scenario.scene, radar).isel(frame=0, target=0)
    range_m, velocity_m_per_s = float(first_truth.range), float(first_truth.velocity)
    direction = (first_truth.azimuth.item(), first_truth.elevation.item())
    tx_gain, rx_gain = float(hardware.tx_gain(*direction)), float(hardware.rx_gain(*direction))
    rcs_m2 = target_cross_sections_m2(
        scenario.scene, first_truth.time.values[None], radar.frame.chirp.wavelength_m
    ).item(0)
    if not tx_gain * rx_gain * rcs_m2:  # zero power has no level in dB
        return None
    echo_w = float(
        received_power_w(
            radar,
            range_m=range_m,
            rcs_m2=rcs_m2,
            azimuth_rad=direction[0],
            elevation_rad=direction[1],
        )
    )
    spreading = radar.frame.chirp.wavelength_m**2 / ((4 * np.pi) ** 3 * range_m**4)
    lines = (
        _level_budget_line("transmit power", hardware.transmit_power_w * 1e3, "dBm", "Pt"),
        *_antenna_budget_lines("transmit", float(hardware.tx_gain()), tx_gain, hardware.tx_pattern),
        _gain_budget_line(f"there and back, {range_m:.4g} m", spreading, "λ² / (4π)³ R⁴"),
        _gain_budget_line("radar cross section", rcs_m2, "RCS"),
        *_antenna_budget_lines("receive", float(hardware.rx_gain()), rx_gain, hardware.rx_pattern),
        _gain_budget_line("losses", 1 / hardware.loss, "1 / L"),
        _level_budget_line("echo in one receiver", echo_w * 1e3, "dBm", "Pr"),
    )
    noise_w = added_noise_power_w(scenario, radar)
    if not noise_w:
        return lines
    noise = (
        _level_budget_line("noise in one sample", noise_w * 1e3, "dBm", "all noise that is added"),
        _level_budget_line("SNR in one sample", echo_w / noise_w, "dB", "Pr / noise"),
    )
    return (
        lines
        + noise
        + _processing_budget_lines(scenario, radar, echo_w / noise_w, range_m, velocity_m_per_s)
    )


def _processing_budget_lines(
    scenario: Scenario, radar: Radar, snr: float, range_m: float, velocity_m_per_s: float
) -> tuple[BudgetLine, ...]:
    """Return gains and losses from one sample to the decision."""
    chirp, frame, chain = radar.frame.chirp, radar.frame.for_frame(0), scenario.chain
    over_range, over_velocity = chain.range_transform(chirp), chain.doppler_transform(frame)
    windows = over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
    place = RangeVelocity(np.array(range_m), np.array(velocity_m_per_s))
    straddle = (
        nearest_cell_snr_fraction(place, radar.for_frame(0), over_range, over_velocity).item()
        * windows
    )
    n_summed = radar.n_summed_maps
    in_map = snr * radar.integration_gain / n_summed / windows * straddle
    per_channel = _gain_budget_line("channels", 1 / n_summed, "the map adds powers, not echoes")
    summing = [per_channel] if n_summed > 1 else []
    half = "" if chirp.sampling == "complex" else " / 2"
    lines = (
        _gain_budget_line(
            "integration", radar.integration_gain, f"samples x chirps x channels{half}"
        ),
        _level_budget_line(
            "SNR after integration", snr * radar.integration_gain, "dB", "sets the errors"
        ),
        _gain_budget_line("windows", 1 / windows, "1 / noise bandwidths in bins"),
        _gain_budget_line("between bins", straddle, "response at the nearest cell"),
        *summing,
        _level_budget_line("SNR in the map", in_map, "dB", "decides on detection"),
    )
    pfa = chain.cfar.false_alarm_probability
    if pfa is None:
        return lines
    needed_snr = _find_or_compute_required_snr(pfa, n_summed)
    formula = f"Pd {DETECTION_PROBABILITY:g} at Pfa {pfa:g}, steady target"
    return (
        *lines,
        _level_budget_line("SNR needed", needed_snr, "dB", formula),
        _gain_budget_line("margin", in_map / needed_snr, ""),
    )


def _find_or_compute_required_snr(pfa: float, n_summed: int) -> float:
    """Return the SNR that a steady target needs, from the disk if it was computed before.

    In the run of one frame, nothing else needs SciPy's special functions; importing them takes
    0.17 s of CPU time.
    """
    key = {
        "detection_probability": DETECTION_PROBABILITY,
        "false_alarm_probability": pfa,
        "n_summed": n_summed,
        "source": source_hash(Path(detection.__file__), Path(swerling.__file__)),
    }
    numbers = read_cached_numbers("required-snr", key)
    if numbers is None:
        numbers = [float(detection.required_snr(DETECTION_PROBABILITY, pfa, n_summed=n_summed))]
        write_cached_numbers("required-snr", key, numbers)
    return numbers[0]


def _antenna_budget_lines(
    side: str, peak_gain: float, gain_towards_target: float, pattern: Pattern | None
) -> tuple[BudgetLine, ...]:
    """Return the gain of an antenna, and the loss of its pattern towards the target."""
    symbol = "Gt" if side == "transmit" else "Gr"
    peak_line = _gain_budget_line(f"{side} antenna", peak_gain, symbol)
    if pattern is None:
        return (peak_line,)
    return peak_line, _gain_budget_line(
        f"off its {side} beam", gain_towards_target / peak_gain, "pattern, towards the target"
    )


def _level_budget_line(name: str, ratio: float, unit: str, formula: str) -> BudgetLine:
    return BudgetLine(
        name=name,
        kind="level",
        level_db=float(to_decibels(ratio)),
        unit="dBm" if unit == "dBm" else "dB",
        formula=formula,
    )


def _gain_budget_line(name: str, ratio: float, formula: str) -> BudgetLine:
    return BudgetLine(
        name=name, kind="step", level_db=float(to_decibels(ratio)), unit="dB", formula=formula
    )
