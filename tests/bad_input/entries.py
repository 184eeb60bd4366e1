"""Every way by which foreign bytes come in, and what each owes them: a value, or one of our errors.

An entry is a function of a file and of an empty folder to work in. `replayed` calls it and judges:
it may return, or raise a `DechirpError` whose mistakes each say where, what was got, what is
needed and how to mend it.
"""

import contextlib
import io
import json
import os
import re
import struct
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from unittest.mock import patch

import numpy as np

from dechirp.core.errors import DechirpError
from dechirp.core.findings import PhysicsWarning
from dechirp.results.hex_vectors import read_vectors, read_words

CORPUS = Path(__file__).with_name("corpus")
Entry = Callable[[Path, Path], object]

RADAR_YAML = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 30 us,
          sample_rate: 10 MHz, n_samples: 8, sampling: complex}
  n_chirps: 2
  interval: 40 us
"""


def replayed(entry: str, file: Path, scratch: Path) -> None:
    """Give a file to an entry point; raises whatever it must not."""
    before = set(file.parent.iterdir())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", PhysicsWarning)
            ENTRIES[entry](file, scratch)
    except DechirpError as error:
        must_say_all(error)
    assert set(file.parent.iterdir()) == before, "left something behind"


def must_say_all(error: DechirpError) -> None:
    """Check that an error says where, what was got, what is needed and how to mend it."""
    assert error.mistakes, "an error without a mistake"
    for one in error.mistakes:
        assert one.setting.strip(), f"no place: {one!r}"
        assert str(one.value).strip(), f"nothing got: {one!r}"
        assert one.expected.strip(), f"nothing needed: {one!r}"
        assert one.fix.strip(), f"no fix: {one!r}"
        assert len(str(one)) < 6000, f"nobody reads that much: {str(one)[:300]}"
        assert "\n" not in str(one), f"more than a line: {one!r}"
        assert all(c.isprintable() for c in str(one)), f"not to be printed: {str(one)!r}"
    assert "Traceback" not in str(error)


# Settings


def _scenario(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load(file)


def _study(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load_study(file)


def _tune(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load_tune(file)


def _radar(file: Path, _: Path) -> object:
    from dechirp.recordings.settings.read import read_radar

    return read_radar(file)


def _requirements(file: Path, _: Path) -> object:
    from dechirp.config import loading
    from dechirp.radar.design.design import design
    from dechirp.radar.design.requirements import Requirements

    return design(loading.read_settings(file, Requirements))


def _calibration(file: Path, _: Path) -> object:
    from dechirp.recordings.settings.calibration import read_calibration

    return read_calibration(file)


def _mesh(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.bodies.Mesh(path=str(file))


def _option(file: Path, _: Path) -> object:
    """`--set`, an option a line: on a scenario, on a study, and as typed into the studio."""
    import dechirp as dc
    from dechirp.studio.scenario_edits import PageLimits, apply_options

    options = file.read_bytes().decode("utf-8", "surrogateescape").split("\n")
    try:
        apply_options(dc.reference(), options, PageLimits())
    except DechirpError as error:
        must_say_all(error)
    return dc.reference(options)


def _studio_text(file: Path, _: Path) -> object:
    """The settings of a page of the studio, as a text."""
    from dechirp.studio.scenario_edits import PageLimits, parse_scenario

    return parse_scenario(file.read_bytes().decode("utf-8", "replace"), PageLimits())


# Files of samples, objects and results


@cache
def _radar_of(sampling: str) -> object:
    from dechirp.config import loading
    from dechirp.radar.radar import Radar

    return loading.parse_settings(RADAR_YAML.replace("complex", sampling), Radar)


_FREE = {"axes": "frame,chirp,rx,sample", "encoding": "full-scale"}
_TOLD: dict[str, dict[str, str]] = {
    ".txt": {"format": "text-columns", "axes": "frame,chirp,sample,iq", "encoding": "int16"},
    ".urad": {"format": "urad"},
    **dict.fromkeys((".npy", ".npz", ".mat", ".h5"), _FREE),
}


def told_of(file: Path) -> dict[str, object]:
    """What a recording of the corpus does not say itself."""
    radar = _radar_of("real" if file.suffix == ".wav" else "complex")
    return {"radar": radar, **_TOLD.get(file.suffix, {})}


def _recording(file: Path, _: Path) -> object:
    from formats.corruption import assert_cube_or_error

    try:
        assert_cube_or_error(file)
    except DechirpError as error:
        must_say_all(error)
    return assert_cube_or_error(file, **told_of(file))


def _bag(file: Path, scratch: Path) -> object:
    """A file of a bag of ROS 2, its messages or what it tells of them, beside a good other one."""
    import dechirp as dc
    from formats.corruption import assert_cube_or_error

    kinds = {".db3": "drive.db3", ".yaml": "metadata.yaml"}
    for suffix, name in kinds.items():
        chosen = file if file.suffix == suffix else CORPUS / "bag" / f"good{suffix}"
        (scratch / name).write_bytes(chosen.read_bytes())
    assert_cube_or_error(scratch)
    return dc.open(scratch)


def _description(file: Path, scratch: Path) -> object:
    """The JSON that our files have beside their samples."""
    import dechirp as dc

    text = file.read_bytes().decode("utf-8", "replace")
    made = scratch / "described.npz"
    cube = np.zeros((1, 2, 1, 8), np.complex64)
    np.savez(made, cube=cube, dechirp=np.array(text))
    opened = dc.open(made)
    return opened, list(opened.frames()), opened.points


def _objects(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.object_lists.read_objects(file)


def _dbc(file: Path, scratch: Path) -> object:
    from dechirp.results.object_lists.can_logs import read_can_log, write_can_log
    from sample_object_lists import random_object_list

    made = scratch / "made.log"
    try:
        write_can_log(random_object_list(2), made, dbc=file)
    except DechirpError:
        assert not list(scratch.iterdir()), "half a log"
        raise
    return read_can_log(made, dbc=file)


def _table(file: Path, _: Path) -> object:
    from dechirp.results.parquet import read_parquet

    return read_parquet(file)


def _vectors(file: Path, scratch: Path) -> object:
    """Words of a bench as they are, and the description of a folder of them."""

    if file.suffix == ".hex":
        return read_words(file, bits=16, signed=True)
    (scratch / "vectors.json").write_bytes(file.read_bytes())
    (scratch / "words.hex").write_text("0001\nffff\n")
    return read_vectors(scratch)


def _record(file: Path, scratch: Path) -> object:
    """The record of a study."""
    from dechirp.experiments.study.ledger_reader import LEDGER_NAME, LedgerReader

    (scratch / LEDGER_NAME).write_bytes(file.read_bytes())
    with LedgerReader.open_existing(scratch) as record:
        numbers = [
            (record.trial_numbers(point), record.point_theory(point))
            for point, _ in record.iter_point_sums()
        ]
        told = record.failures(), record.findings(), record.ended_points(), record.total_seconds()
        return record.identity, record.environments, record.finished_blocks(), numbers, told


# The network


def udp_packets(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Senders and packets in a file: size (uint16), sender (uint8), bytes."""
    at = 0
    while at + 3 <= len(content):
        size, sender = struct.unpack_from("<HB", content, at)
        yield sender, content[at + 3 : at + 3 + size]
        at += 3 + size


def _udp(file: Path, _: Path) -> object:
    """Packets as a DCA1000 sends them, or anything else, put in their places."""
    from dechirp.recordings.live.reassembly import ReassemblyWindow
    from dechirp.recordings.live.socket_reader import PacketSlots

    packets = list(udp_packets(file.read_bytes()))
    content = np.zeros((len(packets), 1472), np.uint8)
    for row, (_sender, packet) in zip(content, packets, strict=True):
        row[: len(packet)] = np.frombuffer(packet[:1472], np.uint8)
    sizes = np.array([len(packet) for _, packet in packets], np.int64)
    senders = np.array([sender for sender, _ in packets], np.int64)
    window = ReassemblyWindow(4096, max_lost_frames=1000)
    last = -1
    placed = window.reassemble_frames(PacketSlots(content, sizes, senders))
    for frame in chain(placed, window.flush_frames_before(2**40)):
        assert frame.number > last, "a frame came twice, or late"
        last = frame.number
        assert frame.received_mask.any(), "a frame of nothing"
        assert not frame.content[~frame.received_mask].any(), "what was lost is not zero"
    assert window.lost_bytes >= 0
    return last


# The command line


def _command_line(file: Path, scratch: Path) -> None:
    """Words of a call, one a line; what would last (servers, certificates) ends where it begins."""
    words = [os.fsdecode(line) for line in file.read_bytes().split(b"\n")]
    called(words, scratch)


def called(words: list[str], folder: Path) -> int:
    """Status of a call from a folder; what it prints must go with it."""
    from dechirp.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    here = Path.cwd()
    os.chdir(folder)
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            contextlib.ExitStack() as stack,
        ):
            for name in _LASTING:
                stack.enter_context(patch(name, side_effect=_no_further))
            main(words)
    except _NoFurther:
        return 0
    except SystemExit as ended:
        status = int(ended.code or 0)
    finally:
        os.chdir(here)
    said = out.getvalue() + err.getvalue()
    assert "Traceback" not in said, said
    assert status in (0, 1, 2), f"{words}: {status}"
    if status == 2:
        _must_be_told(words, out.getvalue(), err.getvalue())
    return status


def _must_be_told(words: list[str], out: str, err: str) -> None:
    """Check that a call which was refused says why, and says it once."""
    if any(word.startswith("--json") for word in words):
        found = json.loads(out)["errors"]
        assert found, words
        assert all(one[key] for one in found for key in ("setting", "value", "expected", "fix")), (
            found
        )
        return
    lines = err.splitlines()
    assert lines, f"{words}: refused without a word"
    said = [line for line in lines if "; expected " in line]
    assert said, lines
    assert all(re.search(r"; expected \S.*; \S.*[^\s.,;:]$", line.rstrip()) for line in said), lines


class _NoFurther(Exception):
    """The call was right, and would now take long."""


def _no_further(*given: object, **_: object) -> None:
    for one in given:  # a server that has its port
        getattr(one, "_socket", contextlib.nullcontext()).__exit__(None, None, None)
    raise _NoFurther


_LASTING = (
    "dechirp.certificate.certificate.verify",
    "dechirp.experiments.study.executors.workers_from_options",
    "dechirp.cli.commands.study._replay_trial",
    "dechirp.experiments.run.run",
    "dechirp.experiments.run.load_frame",
    "dechirp.experiments.twin.twin.twin",
    "dechirp.experiments.inspection.inspect",
    "dechirp.processing.calibration.calibrate.calibrate",
    "dechirp.recordings.convert.write",
    "dechirp.cli.commands.studio._serve_until_signal",
    "dechirp.cli.stream.process_live",
)
"""What commands call once the call and its files are read."""

ENTRIES: dict[str, Entry] = {
    "scenario": _scenario,
    "study": _study,
    "tune": _tune,
    "radar": _radar,
    "requirements": _requirements,
    "calibration": _calibration,
    "mesh": _mesh,
    "option": _option,
    "studio-text": _studio_text,
    "recording": _recording,
    "bag": _bag,
    "description": _description,
    "objects": _objects,
    "dbc": _dbc,
    "table": _table,
    "vectors": _vectors,
    "record": _record,
    "udp": _udp,
    "command-line": _command_line,
}
"""By the names of the folders of the corpus."""

if str(CORPUS.parents[1]) not in sys.path:
    sys.path.insert(0, str(CORPUS.parents[1]))  # helpers of the other tests, for the fuzzers
