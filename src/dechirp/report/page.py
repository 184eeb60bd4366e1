"""One self-contained page that shows a run of the chain."""

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from dechirp.core.words import quantity
from dechirp.evaluate.match import scatterers
from dechirp.process.spectrogram import spectrogram
from dechirp.report import directions, tables, tracked
from dechirp.report.figures import bars, beat, cfar, frames, range_doppler, scene
from dechirp.report.figures import spectrogram as over
from dechirp.report.figures.parts import Axis
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.summary import settings
from dechirp.report.template import template
from dechirp.report.view import View, view_of
from dechirp.scene.folding import Place, folded, on_map
from dechirp.scene.scene import Scene

if TYPE_CHECKING:
    from dechirp.experiment.run import Result

_MOST_ROWS = 50
# Of a spectrogram: limbs keep their speed for about as long, and a figure shows no more columns.
_WINDOW_S, _MOST_WINDOWS = 20e-3, 400
# Fewer chirps tell no velocity over time.
_LEAST_WINDOW = 16
# Frames in which bodies are looked for.
_MOST_LOOKS = 33


def render(result: "Result", *, yaml: str) -> str:
    """Return the HTML of the report; one result always gives one page.

    Parameters
    ----------
    result : Result
        Scene, truth and link budget appear where it has them; a recording has none. Of a
        recording only the first frame is decoded.
    yaml : str
        The scenario as run, shown for others to run again.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    shown = view_of(result)
    rows = tables.detections(shown, _MOST_ROWS)
    return template("page.html").render(
        scenario=result.scenario,
        headline=tables.headline(shown),
        lead=tables.lead(shown),
        cards=tables.cards(shown),
        rows=rows,
        angles=tables.angles(shown),
        errors=tables.errors(rows),
        n_more=max(shown.strongest.sizes["detection"] - _MOST_ROWS, 0),
        n_frames=result.n_frames,
        has_truth=result.truth is not None,
        n_in_map=shown.found.range_m.size,
        is_complex=np.iscomplexobj(shown.first),
        figures=_figures(shown),
        panels=directions.panels(shown),
        has_bodies=shown.scatterers is not None and shown.scatterers.range_m.size > 0,
        targets=tables.targets(shown),
        targets_found=tables.targets_found(shown),
        objects=tracked.about(result),
        tracks=tracked.rows(result, _MOST_ROWS),
        tracks_found=tracked.summary(result),
        most_drawn=tracked.MOST_DRAWN,
        n_tracks=0 if result.tracks is None else result.tracks.sizes["track"],
        budget=bars.waterfall(result.budget or ()),
        settings=settings(result),
        findings=result.findings,
        timing=bars.timing(result.timing_s),
        total=quantity(sum(result.timing_s.values()), "s", 3),
        yaml=yaml,
    )


def _figures(shown: View) -> dict[str, Markup]:
    result, expected = shown.result, shown.expected
    radar, chain = result.radar.at(result.first_frame), result.scenario.chain
    doppler_hz = None
    if shown.found.range_m.size:
        doppler_hz = 2 * float(shown.found.velocity_m_per_s[0]) / radar.frame.chirp.wavelength_m
    # Transmitters in turn have phases of their own, and falling ramps other beat frequencies.
    alike = shown.first.isel(chirp=slice(None, None, radar.frame.n_slots))
    truth_m = [place.range_m for place in (expected, shown.scatterers) if place is not None]
    marked = range_doppler.MarkedMap(
        power=result.power,
        units=shown.units,
        found=shown.found,
        truth=expected,
        scatterers=shown.scatterers,
    )
    drawn = {
        "signal": svg(
            lambda figure: beat.whole_signal(figure, alike, doppler_frequency_hz=doppler_hz)
        ),
        "spectrum": svg(
            lambda figure: beat.spectrum(
                figure.subplots(),
                alike,
                radar.frame.chirp,
                chain,
                truth_m=np.concatenate([[], *truth_m]),
            )
        ),
        "map": svg(
            lambda figure: range_doppler.whole(figure.subplots(), marked), height_in=TALL_IN
        ),
        "close_up": svg(
            lambda figure: range_doppler.close_up(figure.subplots(), marked, cell=shown.cell),
            height_in=TALL_IN,
        ),
        "cut_range": _cut(shown, "range"),
        "cut_velocity": _cut(shown, "velocity"),
    }
    if result.scenario.scene is not None:
        drawn["scene"] = _scene(shown, result.scenario.scene)
    ways = tracked.from_above(shown)
    if ways is not None:
        drawn["tracks"] = ways
    moving_m = _ranges_of_moving_bodies_m(shown)
    if moving_m is not None:
        drawn["spectrogram"] = _spectrogram(result, moving_m)
    if result.n_frames > 1 and shown.strongest.sizes["detection"]:
        drawn["range_over_time"] = _over_time(shown, "range")
        drawn["velocity_over_time"] = _over_time(shown, "velocity")
    return drawn


def _scene(shown: View, there: Scene) -> Markup:
    found = shown.in_first_frame
    without = np.isnan(found.azimuth.values)
    return svg(
        lambda figure: scene.from_above(
            figure.subplots(),
            there,
            time_s=shown.result.radar.at(shown.result.first_frame).frame.mid_frame_s,
            detected_m=found.range.values[without].tolist(),
            seen=directions.seen(shown),
        ),
        height_in=scene.height_in(there),
    )


def _ranges_of_moving_bodies_m(shown: View) -> tuple[float, float] | None:
    """Between which ranges of the map bodies are that swing or turn parts; None without any."""
    scene_, truth, radar = shown.result.scenario.scene, shown.result.truth, shown.result.radar
    if scene_ is None or truth is None or radar.frame.n_chirps < _LEAST_WINDOW:
        return None
    if radar.frame.n_intervals > 1 or radar.frame.falls:
        return None  # what goes through all frames has one interval, and ramps of one kind
    moves = [target.body is not None and not target.body.is_rigid for target in scene_.targets]
    own = np.array(moves, dtype=bool)[scene_.owners]
    if not own.any():
        return None
    times_s = truth.time.values[:: -(-truth.sizes["frame"] // _MOST_LOOKS)]
    there = Place(*(of[:, own] for of in scatterers(scene_, times_s)))
    ranges_m = on_map(folded(there, radar), radar).range_m
    margin_m = 2 * radar.frame.chirp.range_resolution_m  # of the peaks that windows widen
    return float(ranges_m.min()) - margin_m, float(ranges_m.max()) + margin_m


def _spectrogram(result: "Result", range_m: tuple[float, float]) -> Markup:
    frame = result.radar.frame
    n_window = min(max(round(_WINDOW_S / frame.repetition_s), _LEAST_WINDOW), frame.n_chirps)
    hop = max(n_window // 4, frame.n_chirps * result.n_frames // _MOST_WINDOWS)
    chain = result.scenario.chain
    power = spectrogram(
        result.cube,
        result.radar,
        range_m=range_m,
        range_window=chain.range_window,
        n_window=n_window,
        hop=hop,
        n_velocity_bins=2 * n_window,
    )
    return svg(lambda figure: over.over_time(figure.subplots(), power))


def _cut(shown: View, along: Axis) -> Markup:
    result = shown.result
    return svg(
        lambda figure: cfar.cut(
            figure.subplots(),
            result.power,
            result.threshold,
            result.scenario.chain.cfar,
            along=along,
            cell=shown.cell,
            units=shown.units,
        )
    )


def _over_time(shown: View, variable: Axis) -> Markup:
    lines = None
    if shown.result.truth is not None and shown.seen is not None:
        seen = shown.seen.range_m if variable == "range" else shown.seen.velocity_m_per_s
        lines = (shown.result.truth.time.values, seen)
    return svg(
        lambda figure: frames.over_time(
            figure.subplots(), shown.strongest, variable=variable, truth=lines
        )
    )
