"""The link budget of a scenario: from the transmitter to the margin over the threshold."""

import numpy as np

from dechirp.core.units import decibels
from dechirp.echoes.stages import by_stage
from dechirp.evaluate.expected import kept_in_cell
from dechirp.experiment.scenario import Scenario
from dechirp.radar.budget import BudgetLine, received_power_w
from dechirp.radar.patterns.base import Pattern
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.truth import truth
from dechirp.theory.detection import required_snr

DETECTION_PROBABILITY = 0.9


def added_noise_w(scenario: Scenario, radar: Radar) -> float:
    """Power of the noise that the impairments add to each sample, W."""
    assert scenario.scene is not None
    every = by_stage(scenario.impairments, radar).all
    return sum(one.noise_power_w(scenario.scene, radar) for one in every)


def link_budget(scenario: Scenario, radar: Radar) -> tuple[BudgetLine, ...] | None:
    """Powers and gains of the first target's echo, at the middle of the first frame.

    Ends at the margin over what a steady target needs in known noise for a detection
    probability of 0.9. None without a target, or where a pattern does not see it.
    """
    if scenario.scene is None or not scenario.scene.targets:
        return None
    hardware = radar.known_hardware()
    known = truth(scenario.scene, radar).isel(frame=0, target=0)
    range_m, velocity_m_per_s = float(known.range), float(known.velocity)
    towards = (known.azimuth.item(), known.elevation.item())
    tx_gain, rx_gain = float(hardware.tx_gain(*towards)), float(hardware.rx_gain(*towards))
    rcs_m2 = target_cross_sections_m2(
        scenario.scene, known.time.values[None], radar.frame.chirp.wavelength_m
    ).item(0)
    if not tx_gain * rx_gain * rcs_m2:  # of no power, there are no decibels
        return None
    echo_w = float(
        received_power_w(
            radar,
            range_m=range_m,
            rcs_m2=rcs_m2,
            azimuth_rad=towards[0],
            elevation_rad=towards[1],
        )
    )
    spreading = radar.frame.chirp.wavelength_m**2 / ((4 * np.pi) ** 3 * range_m**4)
    lines = (
        _level("transmit power", hardware.transmit_power_w * 1e3, "dBm", "Pt"),
        *_antenna("transmit", float(hardware.tx_gain()), tx_gain, hardware.tx_pattern),
        _step(f"there and back, {range_m:.4g} m", spreading, "λ² / (4π)³ R⁴"),
        _step("radar cross section", rcs_m2, "RCS"),
        *_antenna("receive", float(hardware.rx_gain()), rx_gain, hardware.rx_pattern),
        _step("losses", 1 / hardware.loss, "1 / L"),
        _level("echo in one receiver", echo_w * 1e3, "dBm", "Pr"),
    )
    noise_w = added_noise_w(scenario, radar)
    if not noise_w:
        return lines
    noise = (
        _level("noise in one sample", noise_w * 1e3, "dBm", "all noise that is added"),
        _level("SNR in one sample", echo_w / noise_w, "dB", "Pr / noise"),
    )
    return lines + noise + _processing(scenario, radar, echo_w / noise_w, range_m, velocity_m_per_s)


def _processing(
    scenario: Scenario, radar: Radar, snr: float, range_m: float, velocity_m_per_s: float
) -> tuple[BudgetLine, ...]:
    """Gains and losses from one sample to the decision."""
    chirp, frame, chain = radar.frame.chirp, radar.frame.at(0), scenario.chain
    over_range, over_velocity = chain.over_range(chirp), chain.over_velocity(frame)
    windows = over_range.noise_bandwidth_bins * over_velocity.noise_bandwidth_bins
    place = Place(np.array(range_m), np.array(velocity_m_per_s))
    straddle = kept_in_cell(place, radar.at(0), over_range, over_velocity).item() * windows
    n_summed = radar.n_summed
    in_map = snr * radar.integration_gain / n_summed / windows * straddle
    per_channel = _step("channels", 1 / n_summed, "the map adds powers, not echoes")
    summing = [per_channel] if n_summed > 1 else []
    half = "" if chirp.sampling == "complex" else " / 2"
    lines = (
        _step("integration", radar.integration_gain, f"samples x chirps x channels{half}"),
        _level("SNR after integration", snr * radar.integration_gain, "dB", "sets the errors"),
        _step("windows", 1 / windows, "1 / noise bandwidths in bins"),
        _step("between bins", straddle, "response at the nearest cell"),
        *summing,
        _level("SNR in the map", in_map, "dB", "decides on detection"),
    )
    pfa = chain.cfar.false_alarm_probability
    if pfa is None:
        return lines
    need = required_snr(DETECTION_PROBABILITY, pfa, n_summed=n_summed)
    why = f"Pd {DETECTION_PROBABILITY:g} at Pfa {pfa:g}, steady target"
    return (*lines, _level("SNR needed", need, "dB", why), _step("margin", in_map / need, ""))


def _antenna(
    which: str, peak: float, gain: float, pattern: Pattern | None
) -> tuple[BudgetLine, ...]:
    """The gain of an antenna, and what a pattern takes off towards the target."""
    symbol = "Gt" if which == "transmit" else "Gr"
    at_peak = _step(f"{which} antenna", peak, symbol)
    if pattern is None:
        return (at_peak,)
    return at_peak, _step(f"off its {which} beam", gain / peak, "pattern, towards the target")


def _level(name: str, ratio: float, unit: str, formula: str) -> BudgetLine:
    return BudgetLine(
        name=name,
        kind="level",
        level_db=float(decibels(ratio)),
        unit="dBm" if unit == "dBm" else "dB",
        formula=formula,
    )


def _step(name: str, ratio: float, formula: str) -> BudgetLine:
    return BudgetLine(
        name=name, kind="step", level_db=float(decibels(ratio)), unit="dB", formula=formula
    )
