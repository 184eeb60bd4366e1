"""The figures of the paper: from its document, and from frames simulated with its seed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes

from dechirp.core.units import decibels
from dechirp.core.words import number
from dechirp.experiment.run import Result, run
from dechirp.experiment.scenario import reference
from dechirp.experiment.verify import published
from dechirp.experiment.verify.waveform import synthesised
from dechirp.process.cfar.base import Cells, Ring
from dechirp.report.amounts import typographic
from dechirp.report.figures import (
    beat,
    curves,
    detections,
    detectors,
    diagrams,
    range_doppler,
    rates,
    waveform,
)
from dechirp.report.figures import window as cfar_window
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.view import view_of
from dechirp.scene.folding import Place

OURS = "the chain"


def plates(document: Mapping[str, Any]) -> dict[str, Markup]:
    """Draw all figures, by name."""
    n = document["numbers"]
    quiet, noisy = (_frame(document["seed"], n[name]) for name in ("quiet_snr_db", "report_snr_db"))
    chirp = quiet.radar.frame.chirp
    # A quarter more than the requirements ask for: the rest of the map is noise alone.
    asked_m = _asked_range_m(document) or n["target_range_m"]
    reach_m = 1.25 * asked_m
    ramp = synthesised(chirp, np.arange(chirp.n_samples) / chirp.sample_rate_hz)
    half_way = half_way_db(document)
    frames = [(n["report_snr_db"], noisy)]
    if half_way is not None:
        frames.append((half_way, _frame(document["seed"], half_way)))
    rules = [_rules(result, snr_db) for snr_db, result in frames]
    found, pairs = [
        [curve for curve in document["curves"] if bool(curve["theory_x"]) is against_theory]
        for against_theory in (True, False)
    ]
    resolved = {claim["id"]: claim for claim in document["claims"]}["two_targets_resolved"]
    return {
        "data_flow": svg(lambda figure: diagrams.data_flow(figure.subplots()), height_in=2.85),
        "demodulator": svg(lambda figure: diagrams.demodulator(figure.subplots()), height_in=2.4),
        "frequencies": svg(
            lambda figure: waveform.frequencies(
                figure,
                start_frequency_hz=n["start_frequency_hz"],
                bandwidth_hz=n["bandwidth_hz"],
                chirp_duration_s=n["chirp_duration_s"],
                delay_s=n["delay_s"],
                beat_frequency_hz=n["beat_frequency_hz"],
            ),
            height_in=2.9,
        ),
        "spectrogram": svg(
            lambda figure: waveform.spectrogram(
                figure,
                ramp,
                quiet.cube.values[0, 0, 0],
                chirp.sample_rate_hz,
                slope_hz_per_s=chirp.slope_hz_per_s,
                highest_beat_hz=chirp.beat_frequency_hz(asked_m),
            ),
            height_in=2.8,
        ),
        "window": svg(lambda figure: _window(figure.subplots(), n), height_in=2.9),
        "detectors": svg(detectors.beside_each_other, height_in=detectors.height_in()),
        "spectrum": svg(
            lambda figure: beat.spectrum(figure.subplots(), quiet.cube, chirp, quiet.scenario.chain)
        ),
        **_maps({"map": quiet, "noisy_map": noisy}, reach_m),
        "detections": svg(
            lambda figure: detections.maps(
                figure,
                [[decided for decided, _ in of_frame] for of_frame in rules],
                target=Place(
                    np.array(n["mid_frame_range_m"] + n["coupling_m"]),
                    np.array(n["target_velocity_m_per_s"]),
                ),
                reach=(0.5 * n["target_range_m"], 0.15 * n["max_velocity_m_per_s"]),
            ),
            height_in=1.9 * len(rules) + 0.4,
        ),
        "thresholds": svg(
            lambda figure: detections.thresholds(
                figure,
                [line for _, line in rules[0]],
                around_m=n["target_range_m"],
                reach_m=0.9 * n["target_range_m"],
            ),
            height_in=2.7,
        ),
        "curves": svg(
            lambda figure: curves.detection(
                figure.subplots(), found, confidence=document["confidence"], gap=_gap(document)
            )
        ),
        "resolution": svg(
            lambda figure: curves.resolution(
                figure.subplots(),
                pairs,
                confidence=document["confidence"],
                required=(resolved["required"] or {}).get("at_least"),
            )
        ),
        **_rates(document),
    }


def _rates(document: Mapping[str, Any]) -> dict[str, Markup]:
    """That of the false alarms of every detector, where they were measured."""
    claims = [
        claim
        for part in document["parts"]
        if part["id"] == "false_alarms"
        for claim in part["claims"]
    ]
    if not claims:
        return {}
    kinds = [claim["id"].removeprefix("false_alarms_").replace("_", "-") for claim in claims]
    detectors_ = [
        rates.Rates(name=kind, checks=claim["checks"])
        for kind, claim in zip(kinds, claims, strict=True)
    ]
    return {
        "rates": svg(
            lambda figure: rates.over_design(figure.subplots(), detectors_),
            height_in=rates.height_in(detectors_),
        )
    }


def _window(axes: Axes, n: Mapping[str, Any]) -> Axes:
    ring = Ring(
        n_training=Cells(range=n["training_range"], velocity=n["training_velocity"]),
        n_guard=Cells(range=n["guard_range"], velocity=n["guard_velocity"]),
    )
    return cfar_window.cells(axes, ring, n_training=n["n_training"])


def _frame(seed: int, snr_db: float) -> Result:
    return run(reference([f"seed={seed}", f"impairments.white-noise.snr={snr_db:g} dB"]))


def _asked_range_m(document: Mapping[str, Any]) -> float | None:
    """Range that the requirements ask for, from their table."""
    rows = (row for table in document["tables"] for row in table["rows"])
    return next((row["published"] for row in rows if row["quantity"] == "largest range"), None)


def _maps(results: Mapping[str, Result], reach_m: float) -> dict[str, Markup]:
    """Maps over their mean noise, in the same colours."""
    marked = {name: _marked(result, reach_m) for name, result in results.items()}
    powers = [one.power.values for one in marked.values()]
    highest_db = max(
        float(decibels(power.max() / range_doppler.noise_power(power))) for power in powers
    )

    def over_noise(one: range_doppler.MarkedMap) -> Markup:
        return svg(
            lambda figure: range_doppler.whole_over_noise(
                figure.subplots(), one, highest_db=highest_db
            ),
            height_in=TALL_IN,
        )

    return {name: over_noise(one) for name, one in marked.items()}


def _marked(result: Result, reach_m: float) -> range_doppler.MarkedMap:
    shown = view_of(result)
    return range_doppler.MarkedMap(
        power=result.power.sel(range=slice(0, reach_m)),
        units=shown.units,
        found=shown.found,
        truth=None,  # its cross would hide the peak
    )


def half_way_db(document: Mapping[str, Any]) -> float | None:
    """Ratio half way between the limit of the chain and that of the report's rule."""
    gap = _gap(document)
    return None if gap is None else round((gap.low_db + gap.high_db) / 2, 1)


def _gap(document: Mapping[str, Any]) -> curves.Gap | None:
    """Distance between the limit of the chain, the first check, and the report's, the last."""
    limits = {claim["id"]: claim["checks"] for claim in document["claims"]}["snr_limit"]
    low_db, high_db = limits[0]["measured"], limits[-1]["measured"]
    if low_db is None or high_db is None or not low_db < high_db:
        return None
    share = document["numbers"]["detection_probability"]
    return curves.Gap(low_db=low_db, high_db=high_db, share=share)


def _rules(result: Result, snr_db: float) -> tuple[tuple[detections.Decided, detections.Line], ...]:
    """What the chain and the report's rule make of one frame."""
    ours = result.power.transpose("velocity", "range")
    amplitude, their_threshold, over = published.rule(result.cube.values[0])
    theirs = xr.DataArray(
        amplitude**2,
        dims=("velocity", "range"),
        coords={
            "velocity": ours.velocity,
            # It transforms 4,096 points and keeps the first half.
            "range": np.arange(amplitude.shape[1])
            * result.radar.frame.chirp.max_range_m
            / (2 * amplitude.shape[1]),
        },
    )
    at = f"{number(snr_db)} dB"
    return (
        _rule(f"{OURS}, {at}", ours, result.threshold.transpose("velocity", "range").values),
        _rule(f"{typographic(published.RULE)}, {at}", theirs, their_threshold**2, over=over),
    )


def _rule(
    title: str, power: xr.DataArray, threshold: np.ndarray, *, over: np.ndarray | None = None
) -> tuple[detections.Decided, detections.Line]:
    values = power.values
    noise = range_doppler.noise_power(values)
    row = int(np.unravel_index(np.argmax(values), values.shape)[0])
    range_m = np.asarray(power.range.values)
    return (
        detections.Decided(
            title=title,
            over=values > threshold if over is None else over,
            range_m=range_m,
            velocity_m_per_s=np.asarray(power.velocity.values),
        ),
        detections.Line(
            title=title,
            range_m=range_m,
            power_db=decibels(values[row] / noise),
            threshold_db=decibels(threshold[row] / noise),
        ),
    )
