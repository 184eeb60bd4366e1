"""Reception of DCA1000 packets over UDP as frames."""

import re
import time
from collections.abc import Iterator
from math import ceil
from pathlib import Path

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.recordings.live.packet_ring import UdpReceiver
from dechirp.recordings.live.reassembly import (
    N_DUPLICATES,
    N_FOREIGN_SENDER,
    N_INCONSISTENT,
    N_PACKETS,
    N_REORDERED,
    N_TOO_FAR_AHEAD,
    N_WRONG_SIZE,
    FrameBytes,
    ReassemblyWindow,
)
from dechirp.recordings.live.stream import ReceivedFrame, Stream, settings_from_arguments
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.streams.packets import MAX_PAYLOAD_BYTES

DATA_PORT = 4098
"""Port to which a DCA1000 sends samples."""

_PAUSE_S = 2e-3
_MAX_LOST_S = 60.0  # at a stretch, of the time of the radar
_REJECTION_REASONS = {
    N_WRONG_SIZE: f"not of 11 to {10 + MAX_PAYLOAD_BYTES} bytes",
    N_INCONSISTENT: "with inconsistent counters",
    N_TOO_FAR_AHEAD: f"sent more than {_MAX_LOST_S:g} s ahead of the others, by their counters",
    N_FOREIGN_SENDER: "from another sender",
}


class Listener(Stream):
    """Frames of a DCA1000, received on a UDP port of this machine; see `listen`."""

    def __init__(
        self, host: str, port: int, settings: RecordingSettings, iq: Iq | None, idle_s: float
    ) -> None:
        super().__init__(f"{host}:{port}", settings, iq, idle_s)
        max_lost_frames = ceil(_MAX_LOST_S / self.radar.frame.frame_start_s(1))
        self._window = ReassemblyWindow(self._decoder.frame_bytes, max_lost_frames=max_lost_frames)
        self._n_frames, self._n_incomplete, self._n_omitted = 0, 0, 0
        self._last_number: int | None = None
        self._receiver = UdpReceiver(host, port)

    @property
    def address(self) -> str:
        """Local address, as 127.0.0.1:4098."""
        host, port = self._receiver.address
        return f"{host}:{port}"

    @property
    def n_packets(self) -> int:
        """Number of received packets of any content; `n_waiting` of them are not yet used."""
        return self._receiver.n_packets

    @property
    def n_waiting(self) -> int:
        """Number of received packets that are not yet used."""
        return self._receiver.n_waiting

    def close(self) -> None:
        super().close()
        self._receiver.close()

    def _iter_received_frames(self) -> Iterator[ReceivedFrame]:
        window, receiver = self._window, self._receiver
        n_inserted, last_packet_s = 0, time.monotonic()
        while not (self._is_stopped or window.has_radar_restarted or receiver.error):
            packets = receiver.contiguous_waiting_packets()
            yield from map(self._count_and_convert_frame, window.reassemble_frames(packets))
            receiver.release_packets(len(packets.sizes))
            n_placed = int(window.counters[N_PACKETS])
            if n_placed > n_inserted:
                n_inserted, last_packet_s = n_placed, time.monotonic()
            elif time.monotonic() - last_packet_s > self._idle_s:
                break
            if not len(packets.sizes):
                time.sleep(_PAUSE_S)
        # After a stop the frame in progress is incomplete without loss, so it is not yielded.
        end_number = (
            window.frame_number_in_progress
            if self._is_stopped
            else window.frame_number_in_progress + 1
        )
        yield from map(self._count_and_convert_frame, window.flush_frames_before(end_number))

    def _count_and_convert_frame(self, frame: FrameBytes) -> ReceivedFrame:
        self._n_frames += 1
        self._n_incomplete += not frame.received_mask.all()
        if self._last_number is not None:
            self._n_omitted += frame.number - self._last_number - 1
        self._last_number = frame.number
        return ReceivedFrame(*frame)

    def _transmission_findings(self) -> tuple[Finding, ...]:
        return (
            *self._lost_samples_findings(),
            *self._reordered_and_duplicate_packet_findings(),
            *self._rejected_packet_findings(),
            *self._aborted_stream_findings(),
        )

    def _lost_samples_findings(self) -> Iterator[Finding]:
        if not (self._n_incomplete or self._n_omitted):
            return
        lost_bytes = self._window.lost_bytes
        if not lost_bytes:
            yield _note_without_fix(
                f"{self._n_incomplete} of {self._n_frames} frames have gaps at the beginning"
                " or end of the stream",
                expected="complete frames",
            )
            return
        omitted = f"; {self._n_omitted} more were lost completely" if self._n_omitted else ""
        advice = "process frames faster or fewer of them, since packets arrived too fast; "
        yield Finding(
            level="warning",
            setting="recording",
            value=f"{lost_bytes} bytes lost, {-(-lost_bytes // MAX_PAYLOAD_BYTES)} packets or more:"
            f" {self._n_incomplete} of {self._n_frames} frames have gaps{omitted}",
            expected="every packet that the radar sent",
            fix=f"{advice if self._receiver.was_full else ''}enlarge the packet buffer of the"
            f" system, now {self._receiver.buffer_bytes} bytes (Linux: sysctl"
            " net.core.rmem_max), or the packet delay of the DCA1000; lost samples are zero,"
            " and the coordinate `gap` marks them",
        )

    def _reordered_and_duplicate_packet_findings(self) -> Iterator[Finding]:
        for counter, description in (
            (N_REORDERED, "out of order, sorted by their counters"),
            (N_DUPLICATES, "duplicate or too late for their frame, omitted"),
        ):
            if n := int(self._window.counters[counter]):
                yield _note_without_fix(
                    f"{n} packets {description}", expected="packets in order, each once"
                )

    def _rejected_packet_findings(self) -> Iterator[Finding]:
        if rejected := self._describe_rejected_packets():
            yield Finding(
                level="warning",
                setting="recording",
                value=f"packets that are not samples of this radar, omitted: {rejected}",
                expected="a port that only one DCA1000 sends to",
                fix="find the other sender to the port",
            )

    def _describe_rejected_packets(self) -> str:
        counters = self._window.counters
        return ", ".join(
            f"{counters[counter]} {reason}"
            for counter, reason in _REJECTION_REASONS.items()
            if counters[counter]
        )

    def _aborted_stream_findings(self) -> Iterator[Finding]:
        error = self._receiver.error
        if self._window.has_radar_restarted or error:
            yield Finding(
                level="warning",
                setting="recording",
                value="the radar restarted, or more than"
                f" {_MAX_LOST_S:g} s of it were lost, which ends this stream"
                if error is None
                else f"the system ended the stream ({error.strerror or error})",
                expected="one recording",
                fix="listen again",
            )

    def _no_frames_error(self) -> RecordingError:
        rejected = self._describe_rejected_packets()
        duration = "before it was stopped" if self._was_stop_requested else f"in {self._idle_s:g} s"
        return RecordingError(
            self.address,
            value=f"no packet of samples {duration}{f', but {rejected}' if rejected else ''}",
            expected="an address to which a DCA1000 sends",
            fix="start the radar, check the address of the network card and the firewall, or wait"
            " longer (--idle; idle_s in Python)",
        )


def _note_without_fix(value: str, *, expected: str) -> Finding:
    return Finding(
        level="note",
        setting="recording",
        value=value,
        expected=expected,
        fix="nothing",
    )


@check_argument_types
def listen(
    address: str = "127.0.0.1:4098",
    *,
    radar: Radar | str | Path | None = None,
    settings: str | Path | None = None,
    device: str | None = None,
    iq: Iq | None = None,
    calibration: Calibration | str | Path | None = None,
    idle_s: float = 10.0,
) -> Listener:
    """Receive frames of a DCA1000 over UDP.

    Packets may arrive in any order or twice. Lost samples are zero, and the coordinate `gap`
    (frame,
    chirp) of the cube marks them; frames without any packet are omitted. A frame is yielded when
    it is
    complete, or when the one after the next begins (for small frames: when a packet arrives that
    is 256
    packets ahead), or at the end. Frames are counted from the first that the radar sent, received
    or not.

    Parameters
    ----------
    address : str
        IPv4 address of this machine and UDP port, as 192.168.33.30:4098 or udp://127.0.0.1:4098.
        Port 0: any free one, see `Listener.address`.
    radar, settings, device, iq, calibration
        As for `open`.
    idle_s : float
        Time without packets after which the stream ends, also at the beginning.

    Raises
    ------
    InvalidSetting
        If the address is invalid or not of this machine, or another program uses the port; if the
        radar is not given.
    RecordingError
        If a DCA1000 cannot record the radar; while iterating, if no frame arrives.
    """
    host, port = parse_udp_address(address)
    given_settings = settings_from_arguments(radar, settings, device, calibration)
    if given_settings is None:
        raise InvalidSetting(
            "radar",
            value="missing",
            expected="the radar, which packets do not contain",
            fix="give its settings: --radar FILE (radar=FILE in Python)",
        )
    return Listener(host, port, given_settings, iq, idle_s)


def is_udp_address(text: str) -> bool:
    """Return True if a source is a UDP address; a path object may have lost one of its slashes."""
    return re.match(r"udp:[/\\]", text, re.IGNORECASE) is not None


def parse_udp_address(address: str) -> tuple[str, int]:
    """Parse host and port of an address."""
    form = r"(?:udp:[/\\]{1,2})?([^\s:/\\]*)(?::(\d{1,5}))?"
    match = re.fullmatch(form, str(address).strip(), re.ASCII | re.IGNORECASE)
    port = DATA_PORT if match is None or match[2] is None else int(match[2])
    if match is None or port > np.iinfo(np.uint16).max:
        raise InvalidSetting(
            "address",
            value=address,
            expected="an IPv4 address of this machine and a port, such as udp://127.0.0.1:4098",
            fix="correct it; the default port of a DCA1000 is 4098",
        )
    return match[1] or "127.0.0.1", port
