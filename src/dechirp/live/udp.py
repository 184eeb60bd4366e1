"""A DCA1000 that sends now: its packets as frames."""

import re
import time
from collections.abc import Iterator
from math import ceil
from pathlib import Path

import numpy as np

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.streams.packets import LARGEST_PAYLOAD
from dechirp.live.places import (
    N_PACKETS,
    N_SORTED,
    N_STRANGERS,
    N_TOO_FAR,
    N_TWICE,
    N_WRONG_COUNT,
    N_WRONG_SIZE,
    Frame,
    Window,
)
from dechirp.live.receiver import Receiver
from dechirp.live.stream import Arrived, Stream, settings_of
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

DATA_PORT = 4098
"""To which a DCA1000 sends samples."""

_PAUSE_S = 2e-3
_MOST_LOST_S = 60.0  # at a stretch, of the time of the radar
_WRONG = {
    N_WRONG_SIZE: f"not of 11 to {10 + LARGEST_PAYLOAD} bytes",
    N_WRONG_COUNT: "with counters that do not go together",
    N_TOO_FAR: f"sent more than {_MOST_LOST_S:g} s after the others, by their counters",
    N_STRANGERS: "from another sender",
}


class Listener(Stream):
    """Frames of a DCA1000, from a UDP port of this machine; see `listen`."""

    def __init__(
        self, host: str, port: int, settings: Settings, iq: Iq | None, idle_s: float
    ) -> None:
        super().__init__(f"{host}:{port}", settings, iq, idle_s)
        most_lost = ceil(_MOST_LOST_S / self.radar.frame.start_s(1))
        self._window = Window(self._decoder.frame_bytes, most_lost=most_lost)
        self._n_frames, self._n_touched, self._n_left_out = 0, 0, 0
        self._last: int | None = None
        self._receiver = Receiver(host, port)

    @property
    def address(self) -> str:
        """Where it listens, as 127.0.0.1:4098."""
        host, port = self._receiver.address
        return f"{host}:{port}"

    @property
    def n_packets(self) -> int:
        """Packets that came, whatever they are; `n_waiting` of them are still to be used."""
        return self._receiver.n_packets

    @property
    def n_waiting(self) -> int:
        """Packets that came, and wait to be used."""
        return self._receiver.n_waiting

    def close(self) -> None:
        """See `Stream.close`."""
        super().close()
        self._receiver.close()

    def _arriving(self) -> Iterator[Arrived]:
        window, receiver = self._window, self._receiver
        n_before, changed_s = 0, time.monotonic()
        while not (self._is_stopped or window.began_anew or receiver.failed):
            packets = receiver.waiting()
            yield from map(self._counted, window.place(packets))
            receiver.done_with(len(packets.sizes))
            n_placed = int(window.counters[N_PACKETS])
            if n_placed > n_before:
                n_before, changed_s = n_placed, time.monotonic()
            elif time.monotonic() - changed_s > self._idle_s:
                break
            if not len(packets.sizes):
                time.sleep(_PAUSE_S)
        # Of the frame that is still being sent no part was lost: nobody waits for its end.
        last = window.sending if self._is_stopped else window.sending + 1
        yield from map(self._counted, window.up_to(last))

    def _counted(self, frame: Frame) -> Arrived:
        self._n_frames += 1
        self._n_touched += not frame.arrived.all()
        if self._last is not None:
            self._n_left_out += frame.number - self._last - 1
        self._last = frame.number
        return Arrived(*frame)

    def _said(self) -> tuple[Finding, ...]:
        return (*self._losses(), *self._sorted(), *self._refused(), *self._ended())

    def _losses(self) -> Iterator[Finding]:
        if not (self._n_touched or self._n_left_out):
            return
        lost_bytes = self._window.lost_bytes
        if not lost_bytes:
            yield _note(
                f"{self._n_touched} of {self._n_frames} frames have gaps: the stream begins or ends"
                " within them",
                need="whole frames",
            )
            return
        whole = f"; of {self._n_left_out} more nothing came" if self._n_left_out else ""
        slow = "Frames came faster than they were used: use less of each, or fewer. "
        yield Finding(
            level="warning",
            setting="recording",
            got=f"{lost_bytes} bytes lost, {-(-lost_bytes // LARGEST_PAYLOAD)} packets or more:"
            f" {self._n_touched} of {self._n_frames} frames have gaps{whole}",
            need="every packet that the radar sent",
            fix=f"{slow if self._receiver.was_full else ''}The lost samples are zero, and the"
            " cube's coordinate `gap` marks their chirps. The system keeps"
            f" {self._receiver.buffer_bytes} bytes of packets for a reader that is late"
            " (Linux: sysctl net.core.rmem_max); a longer packet delay of the DCA1000 helps, too.",
        )

    def _sorted(self) -> Iterator[Finding]:
        for counter, what in (
            (N_SORTED, "out of order, sorted by their counters"),
            (N_TWICE, "that came twice, or after their frame, left out"),
        ):
            if n := int(self._window.counters[counter]):
                yield _note(f"{n} packets {what}", need="packets in order, each once")

    def _refused(self) -> Iterator[Finding]:
        if wrong := self._wrong():
            yield Finding(
                level="warning",
                setting="recording",
                got=f"packets that are none of this radar's samples, left out: {wrong}",
                need="a port to which one DCA1000 sends samples, and nobody else anything",
                fix="See what else sends to the port.",
            )

    def _wrong(self) -> str:
        counters = self._window.counters
        return ", ".join(f"{counters[one]} {what}" for one, what in _WRONG.items() if counters[one])

    def _ended(self) -> Iterator[Finding]:
        failed = self._receiver.failed
        if self._window.began_anew or failed:
            yield Finding(
                level="warning",
                setting="recording",
                got="the radar began anew, or more than"
                f" {_MOST_LOST_S:g} s of it were lost, which ends this stream"
                if failed is None
                else f"the system ended the stream ({failed.strerror or failed})",
                need="one recording",
                fix="Listen again for what comes.",
            )

    def _nothing(self) -> RecordingError:
        wrong = self._wrong()
        waited = "before it was stopped" if self._was_told else f"in {self._idle_s:g} s"
        return RecordingError(
            self.address,
            got=f"silent: no packet of samples came {waited}{f', but {wrong}' if wrong else ''}",
            need="an address to which a DCA1000 sends",
            fix="Start the radar, check the address of the network card and the firewall, or wait"
            " longer (--idle; idle_s in Python).",
        )


def _note(got: str, *, need: str) -> Finding:
    return Finding(
        level="note", setting="recording", got=got, need=need, fix="Nothing is to be done."
    )


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
    """Listen to a DCA1000, and give frames as they come.

    Packets may come in any order or twice. Where some were lost, the samples are zero and the
    coordinate `gap` (frame, chirp) of the cube is True; frames of which nothing came are left
    out. A frame is given when it is whole, or when the one after the next begins (where frames are
    small: when packets come that are 256 further), or at the end. Frames are counted from the
    first that the radar sent, whether it was heard or not.

    Parameters
    ----------
    address : str
        IPv4 address of this machine and UDP port, as 192.168.33.30:4098 or udp://127.0.0.1:4098.
        Port 0: any that is free, see `Listener.address`.
    radar, settings, device, iq, calibration
        As `open` takes them.
    idle_s : float
        The stream ends when so long nothing came, at the beginning, too.

    Raises
    ------
    InvalidSetting
        If the address is none, is not of this machine, or another program has the port; if the
        radar is not given.
    RecordingError
        If the radar is not one that a DCA1000 can record; while iterating, if nothing came.
    """
    host, port = parted(address)
    told = settings_of(radar, settings, device, calibration)
    if told is None:
        raise InvalidSetting(
            "radar",
            got="not given",
            need="known: packets do not say what radar sends them",
            fix="Give its settings: --radar FILE (radar=FILE in Python).",
        )
    return Listener(host, port, told, iq, idle_s)


def is_address(text: str) -> bool:
    """Whether a source is a UDP address, and no path; a path may have lost one of two slashes."""
    return re.match(r"udp:[/\\]", text, re.IGNORECASE) is not None


def parted(address: str) -> tuple[str, int]:
    """Host and port of an address."""
    form = r"(?:udp:[/\\]{1,2})?([^\s:/\\]*)(?::(\d{1,5}))?"
    match = re.fullmatch(form, str(address).strip(), re.ASCII | re.IGNORECASE)
    port = DATA_PORT if match is None or match[2] is None else int(match[2])
    if match is None or port > np.iinfo(np.uint16).max:
        raise InvalidSetting(
            "address",
            got=address,
            need="an IPv4 address of this machine and a port, as udp://127.0.0.1:4098",
            fix="Correct it; the port is 4098 unless the DCA1000 was told another.",
        )
    return match[1] or "127.0.0.1", port
