"""What the page shows of directions, where any were told in the first frame."""

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.values import value
from dechirp.core.words import decimals_of, fixed
from dechirp.process.angle.base import SpectralEstimator
from dechirp.process.angle_maps import angle_spectrum, range_azimuth_map
from dechirp.report.figures import birds_eye, directions, ground
from dechirp.report.figures.directions import Towards
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.view import View


@value
class Panel:
    """A figure, its title, and what to see in it."""

    figure: Markup
    title: str
    words: str


def seen(view: View) -> ground.Seen | None:
    """Detections of the first frame on the ground; None where no azimuth was told."""
    found = view.in_first_frame
    found = found.isel(detection=np.flatnonzero(np.isfinite(found.azimuth.values)))
    if not found.sizes["detection"]:
        return None
    radar = view.result.radar.at(view.result.first_frame)
    sure = np.isfinite(found.fold.values)
    return ground.Seen(
        range_m=found.range.values,
        azimuth_rad=found.azimuth.values,
        elevation_rad=np.nan_to_num(found.elevation.values),
        range_std_m=found.range_std.values,
        azimuth_std_rad=found.azimuth_std.values,
        is_sure=sure if len(radar.array.tx_m) > 1 else np.ones_like(sure),
        field_of_view_rad=view.result.scenario.chain.field_of_view.azimuth_rad,
    )


def panels(view: View) -> list[Panel]:
    """Maps and spectra over directions, and for a recording what it has seen from above."""
    on_ground, made = seen(view), []
    if view.result.scenario.scene is None and on_ground is not None:
        made.append(
            Panel(
                figure=svg(
                    lambda figure: birds_eye.from_above(figure.subplots(), on_ground),
                    height_in=TALL_IN,
                ),
                title="From above:",
                words="the detections of the first frame, with ellipses of their errors: long"
                " across the line of sight where angles are known less well than ranges.",
            )
        )
    if on_ground is not None:
        made.append(
            Panel(
                figure=_range_azimuth(view),
                title="Range and azimuth",
                words="in the first frame: the power of a beam, of all velocities the strongest."
                " A target is as wide as the beam; ripples beside it are sidelobes of the array.",
            )
        )
    if _told(view.in_first_frame).any():
        made.append(_spectrum(view))
    return made


def _told(found: xr.Dataset) -> np.ndarray:
    """Whether detections have a direction."""
    return np.isfinite(found.azimuth.values) | np.isfinite(found.elevation.values)


def _range_azimuth(view: View) -> Markup:
    result, found = view.result, view.in_first_frame
    radar, truth = result.radar.at(result.first_frame), None
    power = range_azimuth_map(view.first.isel(frame=0), radar, result.scenario.chain)
    if view.expected is not None and result.truth is not None:
        azimuth = result.truth.azimuth.transpose("target", "frame").values[view.is_point, 0]
        truth = (azimuth, view.expected.range_m)
    told = np.isfinite(found.azimuth.values)
    marked = directions.RangeAzimuth(
        power=power,
        units=view.units,
        found=(found.azimuth.values[told], view.found.range_m[told]),
        truth=truth,
    )
    return svg(
        lambda figure: directions.range_azimuth(figure.subplots(), marked), height_in=TALL_IN
    )


def _spectrum(view: View) -> Panel:
    """Of the strongest detection that has a direction."""
    result, found, chain = view.result, view.in_first_frame, view.result.scenario.chain
    which = int(_told(found).argmax())
    one = found.isel(detection=which)
    radar = result.radar.at(result.first_frame)
    of = angle_spectrum(view.first.isel(frame=0), radar, found, which, chain)
    same = (found.range.values == float(one.range)) & (found.velocity.values == float(one.velocity))
    same |= (found.range.values == float(one.range)) & np.isnan(found.velocity.values)
    at = f"{fixed(float(one.range), min(decimals_of(float(one.range_std)), 2))} m"
    by = f"kind: {of.estimator}" if isinstance(chain.angle, SpectralEstimator) else "beams"
    return Panel(
        figure=svg(
            lambda figure: directions.spectrum(
                figure.subplots(),
                of,
                found=_towards(found, np.flatnonzero(same)),
                truth=_truth(view, same),
            ),
            height_in=TALL_IN,
        ),
        title="Where the strongest comes from:",
        words=f"spectrum over directions of the detection at {at} ({by}). Where it has other"
        " hills nearly as high, the array takes directions for each other.",
    )


def _towards(found: xr.Dataset, places: np.ndarray) -> Towards:
    return Towards(
        np.nan_to_num(found.azimuth.values[places]), np.nan_to_num(found.elevation.values[places])
    )


def _truth(view: View, same: np.ndarray) -> Towards | None:
    """Directions of the targets that those detections are of, but of bodies."""
    truth, matched = view.result.truth, view.matched
    if truth is None or matched is None:
        return None
    in_first = np.flatnonzero(view.strongest.frame.values == view.result.first_frame)
    found = np.unique(matched.target[in_first[same]])
    points = [at for at in found if at >= 0 and view.is_point[at]]
    first = truth.isel(frame=0)
    return Towards(first.azimuth.values[points], first.elevation.values[points])
