"""How far a target of given RCS is detected: the link budget of a design."""

import math

from dechirp.core.findings import Finding
from dechirp.core.units import decibels
from dechirp.radar.budget import noise_power_w, received_power_w
from dechirp.radar.derived import Derived
from dechirp.radar.radar import Radar
from dechirp.radar.requirements import Requirements
from dechirp.theory.detection import required_snr

WINDOW_LOSS = 1.5**2
"""Hann windows over samples and over chirps: 1.5 bins of noise each, 1.761 dB each."""


def reach(radar: Radar, asked: Requirements) -> tuple[tuple[Derived, ...], tuple[Finding, ...]]:
    """Link budget at the largest range, and a finding where it falls short.

    For a steady target in the middle of its cell, in known noise: straddling costs up to
    2.8 dB more with Hann windows, CFAR with some hundred training cells 0.05 dB. Both
    antennas look at it with their largest gain. Nothing where no RCS is asked for.
    """
    if asked.rcs_m2 is None:
        return (), ()
    echo_w = float(received_power_w(radar, range_m=asked.max_range_m, rcs_m2=asked.rcs_m2))
    noise_w = noise_power_w(radar)
    snr = echo_w / noise_w * radar.integration_gain / WINDOW_LOSS
    need = required_snr(asked.detection_probability, asked.false_alarm_probability)
    reached_m = asked.max_range_m * (snr / need) ** 0.25
    target = f"rcs = {asked.rcs_m2:.4g} m2 at R = {asked.max_range_m:.6g} m"
    rows = (
        ("received_power", echo_w, "W", "P Gt Gr lambda^2 rcs / ((4 pi)^3 R^4 L)", target),
        ("noise_power", noise_w, "W", "k T0 F fs", "T0 = 290 K"),
        ("sample_snr", echo_w / noise_w, "1", "received_power / noise_power", "one sample"),
        ("window_loss", WINDOW_LOSS, "1", "1.5 x 1.5", "Hann windows, 1.761 dB each"),
        ("snr", snr, "1", "sample_snr x integration_gain / window_loss", "after integration"),
        (
            "required_snr",
            need,
            "1",
            "Q1(sqrt(2 snr), sqrt(-2 ln Pfa)) = Pd",
            f"Pd = {asked.detection_probability:.6g}, Pfa = {asked.false_alarm_probability:.6g}",
        ),
        ("detection_range", reached_m, "m", "R (snr / required_snr)^(1/4)", target),
    )
    derived = tuple(
        Derived(name=name, value=number, unit=unit, formula=formula, uses=uses)
        for name, number, unit, formula, uses in rows
    )
    return derived, _short(radar, asked, snr, need, reached_m)


def _short(
    radar: Radar, asked: Requirements, snr: float, need: float, reached_m: float
) -> tuple[Finding, ...]:
    if snr >= need:
        return ()
    missing_db = math.ceil(10 * float(decibels(need / snr))) / 10
    chirps = math.ceil(radar.frame.n_chirps * need / snr)
    return (
        Finding(
            level="error",
            setting="requirements.max_range",
            got=f"{decibels(snr):.1f} dB of SNR after integration at {asked.max_range_m:.4g} m",
            need=f"{decibels(need):.1f} dB to detect {asked.rcs_m2:.4g} m2 with probability"
            f" {asked.detection_probability:.4g}",
            fix=f"Add {missing_db:.1f} dB of transmit power, or {missing_db / 2:.2f} dB of antenna"
            f" gain each way, or send {chirps} chirps a frame, or ask for at most"
            f" {math.floor(reached_m * 10) / 10:.1f} m.",
        ),
    )
