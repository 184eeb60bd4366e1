"""Detection in the frames of cubes: processes them one by one and joins their detections."""

import warnings
from collections.abc import Iterable, Iterator

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import (
    SAMPLES_PER_DETECTION,
    count_called_samples,
    plain_twins_in_first_calls,
)
from dechirp.core.conventions import CUBE_AXES
from dechirp.core.detection_columns import UNITS, detections_from_columns
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.processing.chain import Chain
from dechirp.processing.frame import (
    FrameResult,
    find_directions,
    frame_detection_columns,
    process_frame,
)
from dechirp.processing.peaks import MAX_PEAKS
from dechirp.processing.velocity_ambiguity.hypotheses import FramePeaks
from dechirp.processing.velocity_ambiguity.resolve import resolve_across_frames
from dechirp.radar.cube import check_cube_fits_radar
from dechirp.radar.radar import Radar


@check_argument_types
def detect(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.Dataset:
    """Detect targets in each frame of a cube, simulated or recorded.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        complex for complex sampling, real for real, processed in single precision; any
        order of axes. A single frame has an axis `frame` of length 1.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    chain : Chain, optional
        Windows, bins and detector; Hann windows and a 2-D cell-averaging CFAR at 1e-6 if omitted.
        The default training cells become fewer where the map is small.

    Returns
    -------
    Dataset over `detection`
        frame
            Index of the frame in the cube.
        time : s
            Mid-frame, mid-window: the instant to which the estimates refer.
        range : m, velocity : m/s
            Range from the origin, or from the middle of the array where the direction or the
            ambiguity number is unknown; velocity is the rate of change of the range from that
            middle. Receding positive; refined on unwindowed samples, without range-Doppler
            coupling; unambiguous where `ambiguity_number` is known, else aliased into the span
            about zero velocity. A frame of one chirp gives no velocity: NaN, and the range of a
            target at rest.
        snr : ratio
            After integration over all samples, chirps and channels, without the window's loss:
            the standard errors follow from it. The noise is estimated from the corners of the
            training window, which the sidelobes of the target do not reach; a training window of
            few cells (2 x 2 on each side) makes it half a dB too high in the mean.
        range_std : m, velocity_std : m/s
            Standard errors: the Cramer-Rao bound at that ratio, and for the noise of the n
            channels whose powers are added, 1 + n / snr times its variance.
        azimuth : rad, elevation : rad
            Direction of each source that the estimator finds in a detection, left and up
            positive: one row each, strongest first, with the ratio divided by power. NaN where not
            estimated. From the origin where the ambiguity number is known, else from the middle
            of the array. A linear array measures the cone on which a target lies: its angle is
            that of a target at the level of the array (the other angle 0), and so is the offset
            from the middle to the origin. The angles belong to the velocity of their row: another
            ambiguity number changes the phases between transmitters, and with them the angle.
        azimuth_std : rad, elevation_std : rad
            Standard errors, from the Cramer-Rao bound. Those beside echoes that point targets do
            not describe include their sidelobes; see `processing.sidelobe_rejection`. Phases of
            the channels that the amplitudes show are included, see `processing.channel_errors`.
        ambiguity_number, ambiguity_confidence
            Number of unambiguous velocity spans added, and its probability: from the phases
            between transmitters or ramps, from the beats of a triangle, or from frames with other
            intervals. The number is NaN where its probability is below 0.99. Both are NaN for one
            transmitter whose ramps and intervals are alike.
        moving
            1 for targets found in the map without static echoes (`Chain.moving_targets`), 0 for
            those found only in the map with all echoes; NaN without such a map.

    Raises
    ------
    InvalidSetting
        If the cube does not fit the radar, has samples that are not finite, or the training
        cells do not fit into the map.
    NotEnoughMemory
        If the map would not fit.

    Warns
    -----
    PhysicsWarning
        If a map has more than 2,000 peaks: the weaker ones are dropped.
    """
    with plain_twins_in_first_calls(cube.size):
        detections = detections_from_columns(detect_columns([cube], radar, chain))
    count_called_samples(SAMPLES_PER_DETECTION * detections.sizes["detection"])
    return detections


def detect_columns(
    cubes: Iterable[xr.DataArray],
    radar: Radar,
    chain: Chain | None = None,
    *,
    first_frame_number: int = 0,
) -> dict[str, np.ndarray]:
    """Detect targets in cubes of successive frames; arrays instead of the Dataset of `detect`.

    Labels take 1 ms. `first_frame_number` is the number of the first frame. The next cube is
    requested after the frames of the one before are processed. Raises and warns as `detect`.
    """
    processor = FrameProcessor(radar, chain or Chain())
    for frame in processor.process_cubes(cubes, first_frame_number=first_frame_number):
        warn_about_dropped_peaks(frame, stacklevel=5)
    return processor.joined_detection_columns()


class FrameProcessor:
    """Processor of successive frames: yields the result of each, and joins their detections.

    Of frames with intervals in turn, the peaks of all are kept until `joined_detection_columns`
    resolves their velocity ambiguity together; of other frames the columns of the detections alone.
    """

    def __init__(self, radar: Radar, chain: Chain) -> None:
        self._radar, self._chain = radar, chain.fit_to_radar(radar)
        self._is_joint = radar.frame.n_intervals > 1 and radar.frame.n_chirps > 1
        if self._is_joint and chain.moving_targets is not None:
            raise InvalidSetting(
                "Chain.moving_targets",
                value="given for frames of several intervals",
                expected="frames of one interval: the peaks of one map resolve the ambiguity",
                fix="leave it out, or give the filter as mitigation",
            )
        self._peaks: list[FramePeaks] = []
        self._columns: list[dict[str, np.ndarray]] = []

    def process_cubes(
        self, cubes: Iterable[xr.DataArray], *, first_frame_number: int = 0
    ) -> Iterator[FrameResult]:
        """Process the frames of cubes one by one, numbered from `first_frame_number`.

        The results of frames with intervals in turn have no directions: those of
        `joined_detection_columns` follow from the velocities on which all frames agree.
        """
        with_directions = not self._is_joint
        for frame in process_cubes(
            cubes,
            self._radar,
            self._chain,
            first_frame_number=first_frame_number,
            with_directions=with_directions,
        ):
            if self._is_joint:
                self._peaks.append(frame.peaks)
            else:
                self._columns.append(frame.detections)
            yield frame

    def joined_detection_columns(self) -> dict[str, np.ndarray]:
        """Return the columns of the detections of all frames processed, (n_detections,) each."""
        columns = self._columns
        if self._is_joint:
            frames: Iterable[FramePeaks] = self._peaks
            if len(self._peaks) > 1:
                frames = resolve_across_frames(self._peaks, self._radar.frame)
            columns = [
                frame_detection_columns(
                    frame,
                    find_directions(frame.resolved, frame.radar, self._chain),
                    self._chain.max_range_m,
                )
                for frame in frames
            ]
        if len(columns) == 1:
            return columns[0]
        return {
            name: np.concatenate([frame_columns[name] for frame_columns in columns])
            for name in UNITS
        }


def process_cubes(
    cubes: Iterable[xr.DataArray],
    radar: Radar,
    chain: Chain,
    *,
    first_frame_number: int = 0,
    with_directions: bool = True,
) -> Iterator[FrameResult]:
    """Process the frames of cubes one by one and independently, see `process_frame`.

    Raises `InvalidSetting` if a cube does not fit the radar, and as `process_frame`.
    """
    number = first_frame_number
    for cube in cubes:
        check_cube_fits_radar(cube, radar)
        # Labels of a label take 0.03 ms.
        labels = cube.coords.variables
        starts_s = labels["frame"].values if "frame" in labels else None
        is_plain = cube.dims == CUBE_AXES and len(cube) == 1
        for index in range(cube.sizes["frame"]):
            # One frame at a time: no more is read of a cube on disk.
            if is_plain:
                samples = cube.variable.values[0]
            else:
                samples = cube.variable.isel(frame=index).transpose(*CUBE_AXES[1:]).values
            yield process_frame(
                samples,
                radar,
                chain,
                number=number,
                start_s=None if starts_s is None else float(starts_s[index]),
                with_directions=with_directions,
            )
            number += 1


def warn_about_dropped_peaks(frame: FrameResult, *, stacklevel: int = 3) -> None:
    """Warn if a frame has more peaks than are kept."""
    if frame.n_dropped_peaks:
        finding = Finding(
            level="warning",
            setting="chain.cfar",
            value=f"more than {MAX_PEAKS} peaks over threshold; the weakest"
            f" {frame.n_dropped_peaks} are dropped",
            expected=f"at most {MAX_PEAKS} in a frame",
            fix="lower the false-alarm probability",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=stacklevel)
