"""Figures of the paper, from the document and from frames simulated with its seed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes

from dechirp.certificate import published
from dechirp.certificate.waveform import synthesise_ramp
from dechirp.core.text import format_number
from dechirp.core.units import to_decibels
from dechirp.experiments.run import Result, run
from dechirp.experiments.scenario import reference
from dechirp.processing.cfar.base import Cells, TrainingWindow
from dechirp.report.check_values import apply_typography
from dechirp.report.figures import (
    beat,
    curves,
    detections,
    detectors,
    diagrams,
    false_alarm_rates,
    range_doppler,
    waveform,
)
from dechirp.report.figures import training_window as cfar_window
from dechirp.report.figures.style import TALL_IN, render_svg
from dechirp.report.page_context import sort_match_and_locate_detections
from dechirp.scene.aliasing import RangeVelocity

CHAIN_NAME = "chain"


def draw_paper_figures(document: Mapping[str, Any]) -> dict[str, Markup]:
    """Draw all figures of the paper and return them by name."""
    n = document["numbers"]
    quiet, noisy = (
        _run_reference_scenario(document["seed"], n[name])
        for name in ("quiet_snr_db", "report_snr_db")
    )
    chirp = quiet.radar.frame.chirp
    # Beyond 1.25 times the required range the map contains only noise.
    required_range_m = _required_range_m(document) or n["target_range_m"]
    reach_m = 1.25 * required_range_m
    ramp = synthesise_ramp(chirp, np.arange(chirp.n_samples) / chirp.sample_rate_hz)
    midpoint_db = midpoint_of_snr_limits_db(document)
    frames = [(n["report_snr_db"], noisy)]
    if midpoint_db is not None:
        frames.append((midpoint_db, _run_reference_scenario(document["seed"], midpoint_db)))
    decisions = [_decisions_of_chain_and_report_rule(result, snr_db) for snr_db, result in frames]
    detection_curves, resolution_curves = [
        [curve for curve in document["curves"] if bool(curve["theory_x"]) is against_theory]
        for against_theory in (True, False)
    ]
    resolution_claim = {claim["id"]: claim for claim in document["claims"]}["two_targets_resolved"]
    return {
        "data_flow": render_svg(
            lambda figure: diagrams.draw_data_flow(figure.subplots()), height_in=2.85
        ),
        "demodulator": render_svg(
            lambda figure: diagrams.draw_demodulator(figure.subplots()), height_in=2.4
        ),
        "frequencies": render_svg(
            lambda figure: waveform.draw_ramp_frequencies(
                figure,
                start_frequency_hz=n["start_frequency_hz"],
                bandwidth_hz=n["bandwidth_hz"],
                chirp_duration_s=n["chirp_duration_s"],
                delay_s=n["delay_s"],
                beat_frequency_hz=n["beat_frequency_hz"],
            ),
            height_in=2.9,
        ),
        "spectrogram": render_svg(
            lambda figure: waveform.draw_ramp_and_beat_spectrograms(
                figure,
                ramp,
                quiet.cube.values[0, 0, 0],
                chirp.sample_rate_hz,
                slope_hz_per_s=chirp.slope_hz_per_s,
                highest_beat_hz=chirp.beat_frequency_hz(required_range_m),
            ),
            height_in=2.8,
        ),
        "window": render_svg(
            lambda figure: _draw_training_window(figure.subplots(), n), height_in=2.9
        ),
        "detectors": render_svg(
            detectors.draw_detector_comparison, height_in=detectors.figure_height_in()
        ),
        "spectrum": render_svg(
            lambda figure: beat.draw_beat_spectrum_over_range(
                figure.subplots(), quiet.cube, chirp, quiet.scenario.chain, end_m=reach_m
            )
        ),
        **_draw_range_doppler_maps({"map": quiet, "noisy_map": noisy}, reach_m),
        "detections": render_svg(
            lambda figure: detections.draw_detection_maps(
                figure,
                [[mask for mask, _ in frame_decisions] for frame_decisions in decisions],
                target=RangeVelocity(
                    np.array(n["mid_frame_range_m"] + n["coupling_m"]),
                    np.array(n["target_velocity_m_per_s"]),
                ),
                half_widths=(0.5 * n["target_range_m"], 0.15 * n["max_velocity_m_per_s"]),
            ),
            height_in=1.9 * len(decisions) + 0.4,
        ),
        "thresholds": render_svg(
            lambda figure: detections.draw_power_and_threshold_lines(
                figure,
                [line for _, line in decisions[0]],
                around_m=n["target_range_m"],
                reach_m=0.9 * n["target_range_m"],
            ),
            height_in=2.7,
        ),
        "curves": render_svg(
            lambda figure: curves.draw_detection_curves(
                figure.subplots(),
                detection_curves,
                confidence=document["confidence"],
                gap=_gap_between_snr_limits(document),
            )
        ),
        "resolution": render_svg(
            lambda figure: curves.draw_resolution_curves(
                figure.subplots(),
                resolution_curves,
                confidence=document["confidence"],
                required=(resolution_claim["required"] or {}).get("at_least"),
            )
        ),
        **_draw_false_alarm_ratios(document),
    }


def _draw_false_alarm_ratios(document: Mapping[str, Any]) -> dict[str, Markup]:
    """Draw the false-alarm ratios of all detectors; empty if they were not measured."""
    claims = [
        claim
        for part in document["parts"]
        if part["id"] == "false_alarms"
        for claim in part["claims"]
    ]
    if not claims:
        return {}
    kinds = [claim["id"].removeprefix("false_alarms_").replace("_", "-") for claim in claims]
    detector_rates = [
        false_alarm_rates.DetectorRates(name=kind, checks=claim["checks"])
        for kind, claim in zip(kinds, claims, strict=True)
    ]
    return {
        "rates": render_svg(
            lambda figure: false_alarm_rates.draw_false_alarm_ratios(
                figure.subplots(), detector_rates
            ),
            height_in=false_alarm_rates.figure_height_in(detector_rates),
        )
    }


def _draw_training_window(axes: Axes, numbers: Mapping[str, Any]) -> Axes:
    window = TrainingWindow(
        n_training=Cells(range=numbers["training_range"], velocity=numbers["training_velocity"]),
        n_guard=Cells(range=numbers["guard_range"], velocity=numbers["guard_velocity"]),
    )
    return cfar_window.draw_training_window(axes, window, n_training=numbers["n_training"])


def _run_reference_scenario(seed: int, snr_db: float) -> Result:
    return run(reference([f"seed={seed}", f"impairments.white-noise.snr={snr_db:g} dB"]))


def _required_range_m(document: Mapping[str, Any]) -> float | None:
    """Return the required range from the table of requirements; None if it is missing."""
    rows = (row for table in document["tables"] for row in table["rows"])
    return next((row["published"] for row in rows if row["quantity"] == "largest range"), None)


def _draw_range_doppler_maps(
    results: Mapping[str, Result], max_range_m: float
) -> dict[str, Markup]:
    """Draw maps relative to their mean noise with a common colour scale."""
    marked_maps = {
        name: _build_map_with_marked_detections(result, max_range_m)
        for name, result in results.items()
    }
    powers = [marked_map.power.values for marked_map in marked_maps.values()]
    highest_db = max(
        float(to_decibels(power.max() / range_doppler.noise_power_from_median(power)))
        for power in powers
    )

    def over_noise(marked_map: range_doppler.MarkedMap) -> Markup:
        return render_svg(
            lambda figure: range_doppler.draw_map_over_noise(
                figure.subplots(), marked_map, highest_db=highest_db
            ),
            height_in=TALL_IN,
        )

    return {name: over_noise(marked_map) for name, marked_map in marked_maps.items()}


def _build_map_with_marked_detections(
    result: Result, max_range_m: float
) -> range_doppler.MarkedMap:
    context = sort_match_and_locate_detections(result)
    return range_doppler.MarkedMap(
        power=result.power.sel(range=slice(0, max_range_m)),
        units=context.units,
        detections=context.peaks,
        truth=None,  # its cross would hide the peak
    )


def midpoint_of_snr_limits_db(document: Mapping[str, Any]) -> float | None:
    """Return the SNR midway between the limits of the chain and the report's rule."""
    gap = _gap_between_snr_limits(document)
    return None if gap is None else round((gap.low_db + gap.high_db) / 2, 1)


def _gap_between_snr_limits(document: Mapping[str, Any]) -> curves.SnrGap | None:
    """Return the interval between the SNR limits of the chain and of the report's rule."""
    limits = {claim["id"]: claim["checks"] for claim in document["claims"]}["snr_limit"]
    low_db, high_db = limits[0]["measured"], limits[-1]["measured"]
    if low_db is None or high_db is None or not low_db < high_db:
        return None
    share = document["numbers"]["detection_probability"]
    return curves.SnrGap(low_db=low_db, high_db=high_db, probability=share)


def _decisions_of_chain_and_report_rule(
    result: Result, snr_db: float
) -> tuple[tuple[detections.DetectionMask, detections.ThresholdLine], ...]:
    """Return detection mask and threshold of the chain and of the report's rule for one frame."""
    chain_power = result.power.transpose("velocity", "range")
    amplitude, report_threshold, is_detected = published.apply_report_rule(result.cube.values[0])
    report_power = xr.DataArray(
        amplitude**2,
        dims=("velocity", "range"),
        coords={
            "velocity": chain_power.velocity,
            # The rule transforms 4,096 points and retains the first half.
            "range": np.arange(amplitude.shape[1])
            * result.radar.frame.chirp.max_range_m
            / (2 * amplitude.shape[1]),
        },
    )
    level_text = f"{format_number(snr_db)} dB"
    return (
        _detection_mask_and_threshold_line(
            f"{CHAIN_NAME}, {level_text}",
            chain_power,
            result.threshold.transpose("velocity", "range").values,
        ),
        _detection_mask_and_threshold_line(
            f"{apply_typography(published.RULE_NAME)}, {level_text}",
            report_power,
            report_threshold**2,
            is_detected=is_detected,
        ),
    )


def _detection_mask_and_threshold_line(
    title: str, power: xr.DataArray, threshold: np.ndarray, *, is_detected: np.ndarray | None = None
) -> tuple[detections.DetectionMask, detections.ThresholdLine]:
    values = power.values
    noise = range_doppler.noise_power_from_median(values)
    row = int(np.unravel_index(np.argmax(values), values.shape)[0])
    range_m = np.asarray(power.range.values)
    return (
        detections.DetectionMask(
            title=title,
            is_detected=values > threshold if is_detected is None else is_detected,
            range_m=range_m,
            velocity_m_per_s=np.asarray(power.velocity.values),
        ),
        detections.ThresholdLine(
            title=title,
            range_m=range_m,
            power_db=to_decibels(values[row] / noise),
            threshold_db=to_decibels(threshold[row] / noise),
        ),
    )
