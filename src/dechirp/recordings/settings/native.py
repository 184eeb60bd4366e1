"""Settings of a radar in the package's own YAML files."""

from pathlib import Path

from dechirp.config import loading
from dechirp.config.validation import Readers, ValidationContext
from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.errors import InvalidFile, RecordingError
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.base import Device
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.calibration import read_calibration


def read_native_settings(file: Path, text: str, device: Device | None) -> RecordingSettings:
    """Read a radar from a YAML file; one without an array has the antennas of the device."""
    _check_file_holds_radar_alone(file, text)
    readers: Readers = {Calibration: read_calibration}
    n_tx = 0 if device is None else _count_transmitters_without_array(file, text)
    if device is None or not 0 < n_tx <= len(device.tx_m):
        return RecordingSettings(radar=loading.read_settings(file, Radar, readers=readers))
    # The antennas must agree with the multiplexing; their positions follow from the device.
    tx, rx = ([[0, 0, 0]] * n for n in (n_tx, len(device.rx_m)))
    radar = loading.read_settings(
        file, Radar, readers=readers, overrides=[f"array={{tx: {tx}, rx: {rx}}}"]
    )
    return RecordingSettings(radar=radar).with_board_array(device)


def _check_file_holds_radar_alone(file: Path, text: str) -> None:
    """Raise `RecordingError` for a scenario, whose radar is a part of it."""
    try:
        settings = parse_yaml(text, str(file)).content
    except InvalidFile:  # reported where the radar is read
        return
    if isinstance(settings, dict) and "radar" in settings and "frame" not in settings:
        raise RecordingError(
            file,
            value="a scenario, which contains a radar",
            expected="the settings of the radar alone, with frame at the top",
            fix="copy what stands under radar to a file of its own",
        )


def _count_transmitters_without_array(file: Path, text: str) -> int:
    """Count the transmitters of a radar whose file has no array; 0 if it has one, or mistakes."""
    try:
        settings = parse_yaml(text, str(file)).content
        if not isinstance(settings, dict) or "array" in settings or "frame" not in settings:
            return 0
        context = ValidationContext(folder=file.absolute().parent, readers={})
        frame = loading.build_value_from_tree(settings["frame"], Frame, context)
    except InvalidFile:
        return 0
    return 1 + max(transmitter for slot in frame.slot_transmitters for transmitter in slot)
