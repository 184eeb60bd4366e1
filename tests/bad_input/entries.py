"""Entry points for external bytes, each of which returns a value or raises a `DechirpError`.

An entry is a function of a file and an empty working folder. `replay_input` calls it and checks
the result: a return value, or a `DechirpError` whose mistakes contain setting, value, expectation
and fix.
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
from importlib import import_module
from itertools import chain
from pathlib import Path
from unittest.mock import patch

import numpy as np

from dechirp.core.errors import DechirpError
from dechirp.core.findings import PhysicsWarning
from dechirp.radar.radar import Radar
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


def replay_input(entry: str, file: Path, scratch: Path) -> None:
    """Pass a file to an entry point; raise on any exception that is not allowed."""
    files_before = set(file.parent.iterdir())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", PhysicsWarning)
            ENTRIES[entry](file, scratch)
    except DechirpError as error:
        check_error_is_complete(error)
    assert set(file.parent.iterdir()) == files_before, "leftover files"


def check_error_is_complete(error: DechirpError) -> None:
    """Check that an error contains setting, value, expectation and fix."""
    assert error.mistakes, "error without mistakes"
    for mistake in error.mistakes:
        assert mistake.setting.strip(), f"no setting: {mistake!r}"
        assert str(mistake.value).strip(), f"no value: {mistake!r}"
        assert mistake.expected.strip(), f"no expectation: {mistake!r}"
        assert mistake.fix.strip(), f"no fix: {mistake!r}"
        assert len(str(mistake)) < 4000, f"message too long: {str(mistake)[:300]}"
        assert "\n" not in str(mistake), f"more than one line: {mistake!r}"
        assert all(c.isprintable() for c in str(mistake)), (
            f"unprintable characters: {str(mistake)!r}"
        )
    assert "Traceback" not in str(error)


# Settings


def _load_scenario(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load(file)


def _load_study(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load_study(file)


def _load_tune(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.load_tune(file)


def _read_radar(file: Path, _: Path) -> object:
    from dechirp.recordings.settings.read import read_radar

    return read_radar(file)


def _design_radar(file: Path, _: Path) -> object:
    from dechirp.config import loading
    from dechirp.radar.design.design import design
    from dechirp.radar.design.requirements import Requirements

    return design(loading.read_settings(file, Requirements))


def _read_calibration(file: Path, _: Path) -> object:
    from dechirp.recordings.settings.calibration import read_calibration

    return read_calibration(file)


def _load_mesh(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.bodies.Mesh(path=str(file))


def _apply_options(file: Path, _: Path) -> object:
    """Apply `--set` options, one per line, to the reference scenario and in the studio."""
    import dechirp as dc
    from dechirp.studio.scenario_edits import PageLimits, apply_overrides

    options = file.read_bytes().decode("utf-8", "surrogateescape").split("\n")
    try:
        apply_overrides(dc.reference(), options, PageLimits())
    except DechirpError as error:
        check_error_is_complete(error)
    return dc.reference(options)


def _parse_studio_text(file: Path, _: Path) -> object:
    """Parse the settings text of a studio page."""
    from dechirp.studio.scenario_edits import PageLimits, parse_scenario

    return parse_scenario(file.read_bytes().decode("utf-8", "replace"), PageLimits())


# Files of samples, objects and results


@cache
def _build_radar(sampling: str) -> object:
    from dechirp.config import loading
    from dechirp.radar.radar import Radar

    return loading.parse_settings(RADAR_YAML.replace("complex", sampling), Radar)


_CUBE_OPTIONS = {"axes": "frame,chirp,rx,sample", "encoding": "full-scale"}
_READING_OPTIONS: dict[str, dict[str, str]] = {
    ".txt": {"format": "text-columns", "axes": "frame,chirp,sample,iq", "encoding": "int16"},
    ".urad": {"format": "urad"},
    **dict.fromkeys((".npy", ".npz", ".mat", ".h5"), _CUBE_OPTIONS),
}


def reading_options(file: Path) -> dict[str, object]:
    """Return the options needed to read a recording of the corpus."""
    radar = _build_radar("real" if file.suffix == ".wav" else "complex")
    return {"radar": radar, **_READING_OPTIONS.get(file.suffix, {})}


def _open_recording(file: Path, _: Path) -> object:
    from formats.corruption import assert_cube_or_error

    try:
        assert_cube_or_error(file)
    except DechirpError as error:
        check_error_is_complete(error)
    return assert_cube_or_error(file, **reading_options(file))


def _open_bag(file: Path, scratch: Path) -> object:
    """Open a ROS 2 bag of one corpus file (messages or metadata) and a valid counterpart.

    Its messages are opened alone, too.
    """
    import dechirp as dc
    from formats.corruption import assert_cube_or_error

    kinds = {".db3": "drive.db3", ".yaml": "metadata.yaml"}
    for suffix, name in kinds.items():
        source = file if file.suffix == suffix else CORPUS / "bag" / f"good{suffix}"
        (scratch / name).write_bytes(source.read_bytes())
    assert_cube_or_error(scratch)
    assert_cube_or_error(scratch / kinds[".db3"])
    return dc.open(scratch)


def _open_described_archive(file: Path, scratch: Path) -> object:
    """Open an archive with samples and the file as its JSON metadata."""
    import dechirp as dc

    text = file.read_bytes().decode("utf-8", "replace")
    archive = scratch / "described.npz"
    cube = np.zeros((1, 2, 1, 8), np.complex64)
    np.savez(archive, cube=cube, dechirp=np.array(text))
    recording = dc.open(archive)
    return recording, list(recording.frames()), recording.points


def _read_objects(file: Path, _: Path) -> object:
    import dechirp as dc

    return dc.object_lists.read_objects(file)


def _write_and_read_can_log(file: Path, scratch: Path) -> object:
    from dechirp.results.object_lists.can_logs import read_can_log, write_can_log
    from sample_object_lists import random_object_list

    log = scratch / "made.log"
    try:
        write_can_log(random_object_list(2), log, dbc=file)
    except DechirpError:
        assert not list(scratch.iterdir()), "partial log"
        raise
    return read_can_log(log, dbc=file)


def _write_and_read_vendor_log(file: Path, scratch: Path) -> object:
    """Use a file as the mapping of a vendor's DBC, or as the DBC of a shipped mapping."""
    from dechirp.results.object_lists.can_logs import read_can_log, write_can_log
    from sample_object_lists import random_object_list
    from sample_vendor_dbc import LISTS

    log, options = scratch / "made.log", {"dbc": file, "mapping": "toyota-adas"}
    if file.suffix == ".yaml":
        (scratch / "lists.dbc").write_text(LISTS)
        options = {"dbc": scratch / "lists.dbc", "mapping": file}
    write_can_log(random_object_list(2), log, **options)
    return read_can_log(log, **options)


def _read_table(file: Path, _: Path) -> object:
    from dechirp.results.parquet import read_parquet

    return read_parquet(file)


def _read_vectors(file: Path, scratch: Path) -> object:
    """Read hex words, or the JSON description of a folder with them."""
    if file.suffix == ".hex":
        return read_words(file, bits=16, signed=True)
    (scratch / "vectors.json").write_bytes(file.read_bytes())
    (scratch / "words.hex").write_text("0001\nffff\n")
    return read_vectors(scratch)


def _read_study_ledger(file: Path, scratch: Path) -> object:
    """Read the ledger of a study."""
    from dechirp.experiments.study.ledger_reader import LEDGER_NAME, LedgerReader

    (scratch / LEDGER_NAME).write_bytes(file.read_bytes())
    with LedgerReader.open_read_only(scratch) as ledger:
        numbers = [
            (ledger.trial_numbers_of_point(point), ledger.theoretical_values_of_point(point))
            for point, _ in ledger.iter_trial_sums_by_point()
        ]
        outcome = (
            ledger.failed_trials_with_points(),
            ledger.findings_with_points(),
            ledger.n_blocks_of_points_ended_early(),
            ledger.total_computing_seconds(),
        )
        return (
            ledger.study_identity,
            ledger.environments_of_all_runs,
            ledger.saved_point_and_block_numbers(),
            numbers,
            outcome,
        )


# The network


def iter_udp_packets(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Iterate over senders and packets of a file: size (uint16), sender (uint8), bytes."""
    offset = 0
    while offset + 3 <= len(content):
        size, sender = struct.unpack_from("<HB", content, offset)
        yield sender, content[offset + 3 : offset + 3 + size]
        offset += 3 + size


def _reassemble_packets(file: Path, _: Path) -> object:
    """Reassemble frames from packets of a DCA1000, or from any other bytes."""
    from dechirp.recordings.live.reassembly import ReassemblyWindow
    from dechirp.recordings.live.socket_reader import PacketSlots

    packets = list(iter_udp_packets(file.read_bytes()))
    content = np.zeros((len(packets), 1472), np.uint8)
    for row, (_sender, packet) in zip(content, packets, strict=True):
        row[: len(packet)] = np.frombuffer(packet[:1472], np.uint8)
    sizes = np.array([len(packet) for _, packet in packets], np.int64)
    senders = np.array([sender for sender, _ in packets], np.int64)
    window = ReassemblyWindow(4096, max_lost_frames=1000)
    last_number = -1
    frames = window.reassemble_frames(PacketSlots(content, sizes, senders))
    for frame in chain(frames, window.flush_frames_before(2**40)):
        assert frame.number > last_number, "repeated or late frame"
        last_number = frame.number
        assert frame.received_mask.any(), "empty frame"
        assert not frame.content[~frame.received_mask].any(), "lost bytes are not zero"
    assert window.lost_bytes >= 0
    return last_number


# The command line


def _run_command_line(file: Path, scratch: Path) -> None:
    """Run a command with one argument per line, without its long work (servers, certificates)."""
    arguments = [os.fsdecode(line) for line in file.read_bytes().split(b"\n")]
    run_command(arguments, scratch)


def run_command(arguments: list[str], folder: Path) -> int:
    """Run a command in a folder; return its status, after a check of its output."""
    from dechirp.cli.main import main

    for name in _IMPORTING_LONG_RUNNING:
        import_module(name)
    out, err = io.StringIO(), io.StringIO()
    previous_folder = Path.cwd()
    os.chdir(folder)
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            contextlib.ExitStack() as stack,
        ):
            for name in _LONG_RUNNING:
                stack.enter_context(patch(name, side_effect=_stop_before_work))
            main(arguments)
    except _WorkStarted:
        return 0
    except SystemExit as system_exit:
        status = int(system_exit.code or 0)
    finally:
        os.chdir(previous_folder)
    output = out.getvalue() + err.getvalue()
    assert "Traceback" not in output, output
    assert status in (0, 1, 2), f"{arguments}: {status}"
    if status == 2:
        _check_refusal_message(arguments, out.getvalue(), err.getvalue())
    return status


def _check_refusal_message(arguments: list[str], out: str, err: str) -> None:
    """Check that a rejected command prints complete error messages."""
    if any(word.startswith("--json") for word in arguments):
        errors = json.loads(out)["errors"]
        assert errors, arguments
        assert all(
            error[key] for error in errors for key in ("setting", "value", "expected", "fix")
        ), errors
        return
    lines = err.splitlines()
    assert lines, f"{arguments}: rejected without a message"
    messages = [line for line in lines if "; expected " in line]
    assert messages, lines
    assert all(re.search(r"; expected \S.*; \S.*[^\s.,;:]$", line.rstrip()) for line in messages), (
        lines
    )


def _build_small_radar() -> Radar:
    import dechirp as dc

    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=64,
        sampling="complex",
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=16, interval_s=40e-6, period_s=0.05),
        array=dc.Array(tx_m=((0, 0, 0),), rx_m=((0, 0, 0), (0, 1.95e-3, 0))),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0, loss=1.0),
    )


def _step_sensor_model(file: Path, _scratch: Path) -> None:
    """Step a small radar through a view and the same world 0.1 s later."""
    from osi3.osi_sensorview_pb2 import SensorView

    import dechirp as dc

    model = dc.SensorModel(_build_small_radar(), seed=1)
    data = model.step(file.read_bytes())
    later = SensorView.FromString(file.read_bytes())
    for stamped in (later, later.global_ground_truth):
        stamped.timestamp.seconds = data.timestamp.seconds + 1
    model.step(later)


def _open_traffic(file: Path, _scratch: Path) -> None:
    """Read a trace, and build the scenes and the truth of three frames of its first vehicle."""
    import dechirp as dc

    traffic = dc.open_traffic(file)
    radar = _build_small_radar()
    ego = traffic.host if traffic.host is not None else int(traffic.objects["id"].values[0])
    scenes = dc.traffic.FrameScenes(traffic, radar, ego=ego)
    numbers = sorted({0, scenes.n_frames // 2, scenes.n_frames - 1})
    for number in numbers:
        scene = scenes.scene(number)
        assert np.isfinite([target.position_m for target in scene.targets]).all()
    dc.traffic.find_true_objects(scenes, numbers)


class _WorkStarted(Exception):
    """Signal that a valid command starts its long work."""


def _stop_before_work(*arguments: object, **_: object) -> None:
    for argument in arguments:  # closes the socket of a server
        getattr(argument, "_socket", contextlib.nullcontext()).__exit__(None, None, None)
    raise _WorkStarted


_LONG_RUNNING = (
    "dechirp.certificate.certificate.verify",
    "dechirp.experiments.study.executors.workers_from_options",
    "dechirp.cli.commands.study._replay_trial",
    "dechirp.experiments.run.run",
    "dechirp.experiments.run.simulate_or_read_frame_and_radar",
    "dechirp.experiments.twin.twin.twin",
    "dechirp.experiments.inspection.inspect",
    "dechirp.processing.calibration.calibrate.calibrate",
    "dechirp.recordings.convert.write",
    "dechirp.cli.commands.studio._serve_until_signal",
    "dechirp.cli.stream.process_live_frames",
)
"""Functions that commands call after reading arguments and files."""
_IMPORTING_LONG_RUNNING = (
    "dechirp.certificate.paper_figures",
    "dechirp.experiments.study.run",
    "dechirp.studio.library",
)
"""Modules that import one of them by name: imported later, they would keep its replacement."""

ENTRIES: dict[str, Entry] = {
    "scenario": _load_scenario,
    "study": _load_study,
    "tune": _load_tune,
    "radar": _read_radar,
    "requirements": _design_radar,
    "calibration": _read_calibration,
    "mesh": _load_mesh,
    "option": _apply_options,
    "studio-text": _parse_studio_text,
    "recording": _open_recording,
    "bag": _open_bag,
    "description": _open_described_archive,
    "objects": _read_objects,
    "dbc": _write_and_read_can_log,
    "vendor-can": _write_and_read_vendor_log,
    "table": _read_table,
    "vectors": _read_vectors,
    "record": _read_study_ledger,
    "udp": _reassemble_packets,
    "view": _step_sensor_model,
    "traffic": _open_traffic,
    "command-line": _run_command_line,
}
"""Entry functions by folder name of the corpus."""

if str(CORPUS.parents[1]) not in sys.path:
    sys.path.insert(0, str(CORPUS.parents[1]))  # test helpers, for the fuzzers
