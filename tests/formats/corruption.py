"""Corrupted bytes for reader tests, and the check that a reader decodes them or raises an error."""

from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.base import Contents
from dechirp.recordings.recording import open as open_recording


def decode_frames(contents: Contents) -> np.ndarray:
    """Decode all frames of a recording with one receiver, (frame, chirp, 1, sample)."""
    frame = contents.radar.frame
    frames = np.empty(
        (contents.n_frames, frame.n_chirps_total, 1, frame.chirp.n_samples), np.complex64
    )
    for index, out in enumerate(frames):
        contents.decode(index, out)
    return frames


def assert_cube_or_error(path: Path, **options: object) -> None:
    """Fail unless opening gives cubes of the declared shape or a complete `RecordingError`."""
    try:
        recording = open_recording(path, **options)
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
def corrupted_bytes(draw: st.DrawFn, original: bytes) -> bytes:
    """Change bytes of a file, delete or insert a range, or truncate the file."""
    content = bytearray(original)
    # Headers hold sizes and counts: half of the changes hit the first 128 bytes.
    positions = st.one_of(
        st.integers(0, min(len(original), 128) - 1), st.integers(0, len(original) - 1)
    )
    for position, byte in draw(st.lists(st.tuples(positions, st.integers(0, 255)), max_size=8)):
        content[position] = byte
    match draw(st.integers(0, 3)):
        case 1:
            start, stop = sorted((draw(positions), draw(positions)))
            del content[start:stop]
        case 2:
            position = draw(positions)
            content[position:position] = draw(st.binary(max_size=64))
        case 3:
            del content[draw(positions) :]
    return bytes(content)
