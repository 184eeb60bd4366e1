"""Resolution of the velocity ambiguity: within one frame, and across frames of other intervals."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dechirp.core.detection_columns import zero_where_unknown
from dechirp.processing.angle.aperture import FieldOfView
from dechirp.processing.direction_finding import can_resolve_directions, checked_direction_aperture
from dechirp.processing.estimates import principal_doppler_hz, range_velocity_estimates
from dechirp.processing.refine import RefinedPeaks, Tones
from dechirp.processing.velocity_ambiguity import by_frame_intervals, by_ramps, by_transmitters
from dechirp.processing.velocity_ambiguity.hypotheses import (
    FramePeaks,
    ResolvedPeaks,
    unresolved_hypotheses,
)
from dechirp.processing.velocity_ambiguity.triangular_pairing import pair_rising_and_falling_peaks
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


def resolve_velocity_ambiguity(
    peaks: Sequence[RefinedPeaks], radar: Radar, field_of_view: FieldOfView
) -> ResolvedPeaks:
    """Find the Doppler frequencies of the peaks of one frame, unambiguous where possible.

    Parameters
    ----------
    peaks : sequence of RefinedPeaks
        Of the map of the frame; under triangular modulation of the rising and the falling ramps.
    radar : Radar
        With the interval of the frame.
    field_of_view : FieldOfView
        Directions that the phases between transmitters are compared with.
    """
    frame = radar.frame
    by_map = [
        ResolvedPeaks(
            map_peaks,
            principal_doppler_hz(map_peaks.tones, frame),
            unresolved_hypotheses(len(map_peaks.snr)),
        )
        for map_peaks in peaks
    ]
    if frame.has_falling_ramps:
        rising, falling = (_mirror_peaks_of_no_range(resolved, frame).peaks for resolved in by_map)
        return pair_rising_and_falling_peaks(rising, falling, frame)
    (resolved,) = by_map
    if frame.n_slots > 1 and frame.n_chirps > 1 and len(resolved.doppler_hz):
        resolved = _resolve_by_slots(resolved, radar, field_of_view)
    return _mirror_peaks_of_no_range(resolved, frame)


def _resolve_by_slots(
    resolved: ResolvedPeaks, radar: Radar, field_of_view: FieldOfView
) -> ResolvedPeaks:
    """Resolve principal Doppler frequencies by the ramps or transmitters of the slots."""
    frame = radar.frame
    map_peaks, doppler_hz, hypotheses = resolved
    tones, noise = map_peaks.tones, map_peaks.amplitude_noise
    if frame.modulation is not None:
        amplitude = by_ramps.remove_beat_phase(tones.amplitude, tones.fast, frame)
        tones = replace(tones, amplitude=amplitude)
        hypotheses = by_ramps.ambiguity_probabilities(
            amplitude, frame, doppler_hz, map_peaks.snr, noise
        )
    elif can_resolve_directions(radar):
        responses = by_transmitters.channel_responses(
            radar, checked_direction_aperture(radar, field_of_view)
        )
        hypotheses = by_transmitters.ambiguity_probabilities(
            tones.amplitude, frame, doppler_hz, responses, noise
        )
    doppler_hz = (
        doppler_hz
        + zero_where_unknown(hypotheses.certain_ambiguity_numbers_or_nan) / frame.repetition_s
    )
    return ResolvedPeaks(map_peaks._replace(tones=tones), doppler_hz, hypotheses)


def resolve_across_frames(frames: Sequence[FramePeaks], frame: Frame) -> Iterator[FramePeaks]:
    """Resolve the velocity ambiguity of frames with intervals in turn, from all of them.

    `frame` has the intervals. See `by_frame_intervals.ambiguity_probabilities`.
    """
    estimates, at_principal = [], []
    for frame_peaks in frames:
        own_frame = frame_peaks.radar.frame
        resolved = _with_other_doppler(
            frame_peaks.resolved,
            principal_doppler_hz(frame_peaks.resolved.peaks.tones, own_frame),
            own_frame,
        )
        peaks = resolved.peaks
        columns = range_velocity_estimates(
            peaks.tones.fast,
            resolved.doppler_hz,
            peaks.snr,
            own_frame,
            frame_peaks.radar.n_summed_maps,
            sidelobes=peaks.sidelobes,
        )
        estimates.append(
            by_frame_intervals.FrameEstimates(
                number=frame_peaks.number,
                time_s=frame_peaks.time_s,
                range_m=columns["range"],
                velocity_m_per_s=columns["velocity"],
                range_std_m=columns["range_std"],
                velocity_std_m_per_s=columns["velocity_std"],
                hypotheses=resolved.hypotheses,
            )
        )
        at_principal.append(resolved)
    probabilities = by_frame_intervals.ambiguity_probabilities(estimates, frame)
    for frame_peaks, resolved, hypotheses in zip(frames, at_principal, probabilities, strict=True):
        own_frame = frame_peaks.radar.frame
        number = zero_where_unknown(hypotheses.certain_ambiguity_numbers_or_nan)
        unambiguous = _with_other_doppler(
            resolved, resolved.doppler_hz + number / own_frame.repetition_s, own_frame
        )
        unambiguous = unambiguous._replace(hypotheses=hypotheses)
        yield frame_peaks._replace(resolved=_mirror_peaks_of_no_range(unambiguous, own_frame))


def _mirror_peaks_of_no_range(resolved: ResolvedPeaks, frame: Frame) -> ResolvedPeaks:
    """Replace peaks of real samples below range 0 or beyond the largest range by their images.

    An echo and its image are one tone each, with opposite signs of both frequencies. The echo is
    the one whose delay frequency, beat minus Doppler, is from 0 to half the sample rate.
    """
    if frame.chirp.sampling == "complex":
        return resolved
    tones, sidelobes = resolved.peaks.tones, resolved.peaks.sidelobes
    doppler = resolved.doppler_hz * (2 * np.pi / frame.chirp.sample_rate_hz)
    is_image = (tones.fast - doppler) % (2 * np.pi) > np.pi
    if not is_image.any():
        return resolved
    mirrored = Tones(
        slow=np.where(is_image, -tones.slow, tones.slow),
        fast=np.where(is_image, -tones.fast % (2 * np.pi), tones.fast),
        energy=tones.energy,
        amplitude=np.where(is_image[:, None], tones.amplitude.conj(), tones.amplitude),
    )
    if sidelobes is not None:
        components = sidelobes.components
        sidelobes = sidelobes._replace(
            components=np.where(is_image[:, None, None], components.conj(), components)
        )
    number = resolved.hypotheses.number
    return ResolvedPeaks(
        peaks=resolved.peaks._replace(tones=mirrored, sidelobes=sidelobes),
        doppler_hz=np.where(is_image, -resolved.doppler_hz, resolved.doppler_hz),
        hypotheses=resolved.hypotheses._replace(
            number=np.where(is_image[:, None], -number, number)
        ),
    )


def _with_other_doppler(
    resolved: ResolvedPeaks, doppler_hz: np.ndarray, frame: Frame
) -> ResolvedPeaks:
    """Return peaks with other Doppler frequencies; the beats of triangles keep their ranges."""
    peaks = resolved.peaks
    if frame.has_falling_ramps:
        rad_per_hz = 2 * np.pi / frame.chirp.sample_rate_hz
        fast = peaks.tones.fast + rad_per_hz * (doppler_hz - resolved.doppler_hz)
        peaks = peaks._replace(tones=replace(peaks.tones, fast=fast))
    return resolved._replace(peaks=peaks, doppler_hz=doppler_hz)
