"""Moments of one scenario, step after step; all of it on the worker."""

from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.conventions import axis
from dechirp.core.findings import Finding, heard
from dechirp.experiment.followed import grouped, tracked_rows
from dechirp.experiment.run import Found, about_chain, about_found
from dechirp.experiment.scenario import Scenario
from dechirp.process.angle_maps import range_azimuth_map
from dechirp.process.chain import Chain
from dechirp.process.detect import detected_columns, labelled_detections
from dechirp.process.maps import power_map
from dechirp.process.mitigation.cleaned import Removed
from dechirp.process.sources import aperture_of, tells_directions
from dechirp.radar.radar import Radar
from dechirp.studio.moment import Moment
from dechirp.studio.past import Kept, Past
from dechirp.studio.pointing import Cursor, strongest
from dechirp.studio.settings import Limits
from dechirp.studio.sources import Frames, frames_of
from dechirp.tracking.live import Track

_LIMITS = Limits()


class Player:
    """What the radar of a scenario sees, frame by frame.

    A step is a frame: of a scene of n frames step s shows frame s mod n, with noise that is drawn
    by the seed and s; a recording goes round. What a scenario needs once is made on the first
    look. Tracks and micro-Doppler are told from step to step; after a rewind or a jump, and where
    frames go round, they begin again.
    """

    def __init__(self, scenario: Scenario, limits: Limits = _LIMITS) -> None:
        self._scenario, self._limits = scenario, limits
        self._made: _Made | None = None
        self._recent: list[_Seen] = []

    def look(self, step: int, cursor: Cursor | None) -> Moment:
        """What is seen at a step.

        Raises
        ------
        DechirpError
            If a setting cannot work, or a frame cannot be read.
        """
        started = perf_counter()
        whole("step", step, at_least=0)
        is_first = self._made is None
        if self._made is None:
            self._made = _Made(self._scenario, self._limits)
        made = self._made
        seen = next((one for one in self._recent if one.step == step), None)
        if seen is None:
            before, self._recent = self._recent[-1:], []  # after a frame that fails none goes on
            goes_on = bool(before) and step == before[0].step + 1
            seen = made.see(step, goes_on=goes_on)
            # Two, so that a page that pauses may have had the next one made already.
            self._recent = [*before, seen]
        moment = Moment(
            step=step,
            number=seen.number,
            n_frames=made.frames.n_frames,
            time_s=seen.time_s,
            radar=seen.radar,
            chain=made.chain,
            cursor=cursor or seen.strongest,
            was_told=cursor is not None,
            samples=seen.samples,
            power=seen.power,
            azimuth_power=seen.azimuth_power,
            past=seen.past,
            detections=seen.detections,
            clusters=seen.clusters,
            tracks=seen.tracks,
            truth=made.frames.truth(step),
            findings=(*made.findings, *seen.findings),
            took_s=perf_counter() - started,
        )
        if is_first:  # what it compiles takes seconds: here, not where the page asks for it
            _ = moment.beat, moment.cuts, moment.micro_doppler
        return moment


@dataclass(frozen=True, eq=False)
class _Seen:
    """What follows from the samples of a step, wherever the cursor is."""

    step: int
    number: int
    time_s: float
    radar: Radar
    samples: xr.DataArray
    power: xr.DataArray
    strongest: Cursor
    azimuth_power: xr.DataArray | None
    detections: xr.Dataset
    clusters: xr.Dataset | None
    tracks: tuple[Track, ...]
    past: tuple[Kept, ...]
    """Of this frame and those before it."""
    findings: tuple[Finding, ...]


class _Made:
    """What a scenario needs once, and what it keeps from frame to frame."""

    def __init__(self, scenario: Scenario, limits: Limits) -> None:
        self.frames: Frames = frames_of(scenario, limits)
        radar = self.frames.radar
        self.chain = scenario.chain.fitted(radar)
        self.findings = (*self.frames.findings, *about_chain(scenario.chain, radar))
        self.past = Past(scenario.tracker, radar)
        self._scenario = scenario
        self._tells_azimuth = (
            tells_directions(radar) and aperture_of(radar, self.chain.field_of_view).tells[0]
        )

    def see(self, step: int, *, goes_on: bool) -> _Seen:
        cube, number = self.frames.cube(step), self.frames.number(step)
        radar = self.frames.radar.at(number)
        frame = self.frames.radar.frame
        start_s = cube.frame.item() if "frame" in cube.coords else frame.start_s(number)
        time_s = start_s + radar.frame.mid_frame_s
        if not (goes_on and self.past.goes_on(time_s)):
            self.past.begin()
        samples = cube.isel(frame=0)
        found, power = self._detected(cube, samples, number, time_s)
        followed = grouped(found.detections, self._scenario, self.frames.radar)
        at = strongest(power, found.detections, radar)
        tracks = self.past.tracks(tracked_rows(followed.rows, self.frames.radar), time_s)
        self.past.keep(power, radar, time_s, at.range_m)
        return _Seen(
            step=step,
            number=number,
            time_s=time_s,
            radar=radar,
            samples=samples,
            power=power,
            strongest=at,
            azimuth_power=(
                range_azimuth_map(samples, radar, self.chain) if self._tells_azimuth else None
            ),
            detections=followed.detections,
            clusters=followed.clusters,
            tracks=tracks,
            past=self.past.frames,
            findings=(*about_found(found, radar), *followed.findings),
        )

    def _detected(
        self, cube: xr.DataArray, samples: xr.DataArray, number: int, time_s: float
    ) -> tuple[Found, xr.DataArray]:
        """Detections of a frame, and its map."""
        radar = self.frames.radar
        maps: list[np.ndarray] = []
        took_out: list[tuple[Removed, ...]] = []
        with heard() as crowded:
            columns = detected_columns(
                [cube],
                radar,
                self.chain,
                first=number,
                took_out=took_out.append,
                maps=lambda power: maps.append(power.copy()),
            )
        found = Found(
            first_frame=number,
            detections=labelled_detections(columns),
            times_s=(time_s,),
            took_out=tuple(took_out),
            n_crowded=len(crowded),
        )
        of_frame = radar.at(number)
        if radar.frame.falls:  # a map of each side, where one of both is shown
            return found, power_map(samples, of_frame, self.chain)
        return found, _labels(of_frame, self.chain, cube.attrs["units"]).copy(
            deep=False, data=maps[0]
        )


@lru_cache(maxsize=8)  # 0.7 ms
def _labels(radar: Radar, chain: Chain, units: str) -> xr.DataArray:
    """A map without power."""
    velocity_m_per_s = radar.frame.velocity_bins_m_per_s(chain.over_velocity(radar.frame).n_bins)
    range_m = radar.frame.chirp.range_bins_m(chain.over_range(radar.frame.chirp).n_bins)
    return xr.DataArray(
        np.zeros((velocity_m_per_s.size, range_m.size), np.float32),
        dims=("velocity", "range"),
        coords={"velocity": axis("velocity", velocity_m_per_s), "range": axis("range", range_m)},
        attrs={"units": "W" if units == "sqrt(W)" else "full scale squared", "long_name": "power"},
    )
