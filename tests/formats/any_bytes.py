"""What every reader owes any bytes at all: a cube of the shape it says, or one clear error."""

from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.base import Contents
from dechirp.recordings.recording import open as open_recording


def decoded(contents: Contents) -> np.ndarray:
    """All frames of one receiver that a format found, (frame, chirp, 1, sample)."""
    frame = contents.radar.frame
    frames = np.empty(
        (contents.n_frames, frame.n_chirps_total, 1, frame.chirp.n_samples), np.complex64
    )
    for index, out in enumerate(frames):
        contents.decode(index, out)
    return frames


def gives_a_cube_or_says_why(path: Path, **told: object) -> None:
    """Open and decode; anything but samples as declared or a full `RecordingError` fails."""
    try:
        recording = open_recording(path, **told)
        if recording.points is not None:
            assert len(np.unique(recording.points.frame)) <= recording.n_frames
        if not recording.sizes:
            return
        radar = recording.radar
        for cube in recording.frames():
            shape = (1, radar.frame.n_chirps_total, radar.array.n_rx, radar.frame.chirp.n_samples)
            assert cube.shape == shape
            assert np.isfinite(cube.values).all()
    except RecordingError as error:
        for mistake in error.mistakes:
            assert mistake.value
            assert mistake.expected
            assert mistake.fix


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """Bytes of a whole file with some changed, a part taken out or put in, or the end cut off."""
    content = bytearray(whole)
    # Heads are where sizes and counts stand: half of the damage goes there.
    places = st.one_of(st.integers(0, min(len(whole), 128) - 1), st.integers(0, len(whole) - 1))
    for place, byte in draw(st.lists(st.tuples(places, st.integers(0, 255)), max_size=8)):
        content[place] = byte
    match draw(st.integers(0, 3)):
        case 1:
            first, last = sorted((draw(places), draw(places)))
            del content[first:last]
        case 2:
            place = draw(places)
            content[place:place] = draw(st.binary(max_size=64))
        case 3:
            del content[draw(places) :]
    return bytes(content)
