"""Settings of a recording: its radar, and the layout of its samples."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar

Iq = Literal["iq", "qi"]
"""Order of the in-phase and the quadrature part of a sample."""


@frozen_dataclass
class RecordingSettings:
    """The radar of a recording, and the layout of its samples."""

    radar: Radar
    iq: Iq | None = None
    """Order of I and Q; None if unknown."""
    n_frames: int | None = None
    """Frames configured on the radar; None if unknown."""
    has_merged_frames: bool = False
    """Whether frames of one chirp each were merged into one frame."""
    is_interleaved: bool | None = None
    """Whether the samples of the receivers alternate (True), or lie one receiver after the other in
    a chirp (False); None if unknown.
    """
    bits: int = 16
    """Bits of the ADC codes, which lie in 16-bit words."""
    receivers: tuple[int, ...] | None = None
    """Receivers of the chip in use, from 0; None if unknown."""
    device: str | None = None
    """Kind of the chip, as in `radar.devices`; None if unknown."""
    path: Path | None = None
    """The settings file; None for settings made in Python."""
    findings: tuple[Finding, ...] = ()
    foreign_stream: str = ""
    """Settings by which the samples of a capture board have headers or other data among them; empty
    if they have not."""
    sub_frames: tuple["RecordingSettings", ...] = ()
    """Settings of the sub-frames of a frame, in the order of their samples; empty if the samples
    of a frame are those of the radar alone."""
    sub_frame_index: int = 0
    """Index among the sub-frames of the one that the radar describes."""

    def with_sub_frame(self, index: int) -> "RecordingSettings":
        """Return the settings of another sub-frame of the same recording."""
        others = f"/0 to /{len(self.sub_frames) - 1}"
        note = Finding(
            level="note",
            setting="recording",
            value=f"frames of {len(self.sub_frames)} sub-frames, of which number {index} is read",
            expected="one sub-frame of equal chirps",
            fix=f"append {others} to the name of the recording to choose another",
        )
        sub_frame = self.sub_frames[index].with_findings(note)
        return replace(sub_frame, path=self.path, sub_frames=self.sub_frames, sub_frame_index=index)

    def with_radar(self, radar: Radar) -> "RecordingSettings":
        """Return the layout with another radar."""
        return replace(self, radar=radar, n_frames=None, findings=())

    def with_findings(self, *findings: Finding) -> "RecordingSettings":
        """Return the settings with further findings."""
        return replace(self, findings=(*self.findings, *findings))

    def completed_from_device(self, device: Device | None) -> "RecordingSettings":
        """Return the settings, completed by the properties of a chip."""
        if device is None:
            return self
        interleaved = None if device.lvds_lanes is None else device.lvds_lanes == 4
        return replace(
            self,
            is_interleaved=interleaved if self.is_interleaved is None else self.is_interleaved,
            device=self.device or device.kind(),
        )

    def with_board_array(self, device: Device) -> "RecordingSettings":
        """Return the settings with all receivers of a board, and its first transmitters.

        The radar keeps its number of transmitters.
        """
        n_tx, n_rx = len(self.radar.array.tx_m), len(device.rx_m)
        masks = 2**n_tx - 1, 2**n_rx - 1
        radar = replace(
            self.radar,
            array=device.select_antennas(*masks),
            calibration=self.radar.calibration or device.sign_calibration(*masks),
        )
        note = Finding(
            level="note",
            setting="radar.array",
            value=f"missing, assumed: the {n_rx} receivers of {device.name}, and its"
            f" transmitter{'s 1 to ' + str(n_tx) if n_tx > 1 else ' 1'}",
            expected="the antennas that were in use",
            fix="no action needed if all were; else give radar.array",
        )
        return replace(self, radar=radar, receivers=tuple(range(n_rx))).with_findings(note)

    def chip_receiver_indices(self, n_rx: int) -> tuple[int, ...]:
        """Return the receivers of the chip in the array; the first ones if unknown."""
        receivers = self.receivers
        return receivers if receivers is not None and len(receivers) == n_rx else tuple(range(n_rx))


@contextmanager
def convert_setting_errors(file: Path) -> Iterator[None]:
    """Convert invalid settings to a `RecordingError` that names their file."""
    try:
        yield
    except InvalidSetting as error:
        raise RecordingError(
            file,
            value=f"impossible settings ({error})",
            expected="the settings of a real radar",
            fix="check whether it is the right file, or give the radar",
        ) from None
