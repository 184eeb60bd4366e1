"""The settings of a run as words: groups of names and values with units."""

from typing import TYPE_CHECKING

from dechirp.core.words import TIMES, fixed, number, quantity, ratio_db, small
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.patterns.base import Pattern
from dechirp.radar.radar import Radar

if TYPE_CHECKING:
    from dechirp.experiment.run import Result

Group = tuple[str, list[tuple[str, str]]]


def settings(result: "Result") -> list[Group]:
    """List waveform, what follows from it, hardware where it is known, and processing."""
    radar = result.radar
    groups = [("Waveform", _waveform(radar)), ("What follows from it", _limits(radar))]
    if radar.hardware is not None:
        groups.append(("Hardware", _hardware(radar)))
    if result.scenario.scene is not None:
        groups.append(("Echoes", _echoes(result)))
    groups.append(("Processing", _processing(result)))
    return groups


def waveform_and_limits(radar: Radar) -> list[tuple[str, str]]:
    """List what a radar sends, and what it can therefore see."""
    return _waveform(radar) + _limits(radar)


def _waveform(radar: Radar) -> list[tuple[str, str]]:
    frame, chirp = radar.frame, radar.frame.chirp
    return [
        ("start frequency", quantity(chirp.start_frequency_hz, "Hz", 6)),
        ("slope", f"{number(chirp.slope_hz_per_s / 1e12, 5)} MHz/µs"),
        ("sampling starts after", quantity(chirp.adc_start_s, "s")),
        ("ramp", quantity(chirp.ramp_duration_s, "s", 5)),
        ("samples", f"{chirp.n_samples}, {chirp.sampling}"),
        ("sample rate", quantity(chirp.sample_rate_hz, "Hz", 5)),
        ("chirps in a frame", _chirps(frame)),
        ("chirp interval", _intervals(frame)),
        *([("transmitters", _transmitters(radar))] if len(radar.array.tx_m) > 1 else []),
        ("receivers", f"{radar.array.n_rx}"),
    ]


def _intervals(frame: Frame) -> str:
    each_s = [frame.at(index).only_interval_s for index in range(frame.n_intervals)]
    said = ", ".join(quantity(one_s, "s", 5) for one_s in each_s)
    return said if len(each_s) == 1 else f"{said}, frame by frame"


def _chirps(frame: Frame) -> str:
    if frame.n_slots == 1:
        return f"{frame.n_sent}"
    each = "of each transmitter" if frame.turns is not None else f"rounds of {frame.n_slots}"
    if frame.modulation is not None:
        each += f", {frame.modulation.kind().replace('-', ' ')}"
    return f"{frame.n_sent}, {frame.n_chirps} {each}"


def _transmitters(radar: Radar) -> str:
    multiplexing, n = radar.frame.multiplexing, len(radar.array.tx_m)
    assert multiplexing is not None
    if radar.frame.turns is not None:
        return f"{n}, in turns"
    return f"{n}, together: {multiplexing.kind().replace('-', ' ')}"


def _limits(radar: Radar) -> list[tuple[str, str]]:
    frame, chirp = radar.frame.at(0), radar.frame.chirp
    velocities = [
        ("velocity resolution", f"{number(frame.velocity_resolution_m_per_s)} m/s"),
        ("largest velocity", f"± {number(frame.max_velocity_m_per_s, 5)} m/s"),
    ]
    return [
        ("sampled bandwidth", quantity(chirp.sampled_bandwidth_hz, "Hz", 5)),
        ("wavelength, mid-window", quantity(chirp.wavelength_m, "m", 5)),
        ("range resolution", f"{number(chirp.range_resolution_m)} m"),
        ("largest range", f"{number(chirp.max_range_m, 5)} m"),
        *(velocities if frame.n_chirps > 1 else []),
        ("frame duration", quantity(frame.duration_s, "s")),
        ("integration gain", _db(radar.integration_gain)),
    ]


def _hardware(radar: Radar) -> list[tuple[str, str]]:
    hardware = radar.known_hardware()
    return [
        ("transmit power", f"{fixed(ratio_db(hardware.transmit_power_w) + 30, 1)} dBm"),
        *_antennas(hardware),
        ("EIRP", f"{fixed(ratio_db(hardware.eirp_w) + 30, 1)} dBm"),
        ("noise figure", _db(hardware.noise_factor)),
        ("loss", _db(hardware.loss)),
    ]


def _antennas(hardware: Hardware) -> list[tuple[str, str]]:
    tx, rx = (
        f"{fixed(ratio_db(float(gain)), 1)} dBi"
        for gain in (hardware.tx_gain(), hardware.rx_gain())
    )
    if hardware.tx_pattern is None and hardware.rx_pattern is None:
        return [("antenna gain, each", tx)]
    return [
        (f"transmit antenna, {_pattern(hardware.tx_pattern)}", tx),
        (f"receive antenna, {_pattern(hardware.rx_pattern)}", rx),
    ]


def _pattern(pattern: Pattern | None) -> str:
    if pattern is None:
        return "all directions alike"
    return f"{pattern.kind().replace('-', ' ')}, peak"


_LATE = {
    "held": "held back to the first sample",
    "onset": "begin when they arrive",
    "tail": "begin when they arrive, after the last chirp's tail",
}


def _echoes(result: "Result") -> list[tuple[str, str]]:
    engine, scene = result.scenario.engine, result.scenario.scene
    assert scene is not None
    taken = result.cube.attrs.get("kernels")
    kernel = f"{engine.kernel}: {taken}" if taken else engine.kernel
    tolerance = small(engine.tolerance_of(result.cube.dtype))
    return [
        ("targets", f"{len(scene.targets)}"),
        ("scatterers", f"{scene.n_scatterers}"),
        ("kernel", kernel),
        ("tolerance", f"{tolerance} of the root mean square"),
        ("late echoes", _LATE[engine.late]),
    ]


def _processing(result: "Result") -> list[tuple[str, str]]:
    chain, chirp = result.scenario.chain, result.radar.frame.chirp
    cfar = chain.cfar
    sizes = result.power.sizes
    rows = [
        ("range window", chain.range_window),
        ("Doppler window", chain.doppler_window),
        ("map", f"{sizes['range']} ranges {TIMES} {sizes['velocity']} velocities"),
        ("threshold", f"CFAR, {cfar.estimator.kind().replace('-', ' ')}"),
        (
            "training cells, each side",
            f"{cfar.n_training.range} in range, {cfar.n_training.velocity} in velocity",
        ),
        (
            "guard cells, each side",
            f"{cfar.n_guard.range} in range, {cfar.n_guard.velocity} in velocity",
        ),
    ]
    if cfar.false_alarm_probability is not None:
        rows.append(("false-alarm probability", f"{small(cfar.false_alarm_probability)} per cell"))
    if cfar.offset is not None:
        rows.append(("threshold over noise", _db(cfar.offset)))
    if chain.angle is not None:
        rows.append(("directions", chain.angle.kind().replace("-", " ")))
    if chain.n_range_bins not in (None, chirp.n_samples):
        rows.append(("range transform", f"{chirp.n_samples} samples to {chain.n_range_bins} bins"))
    return rows + _following(result)


def _following(result: "Result") -> list[tuple[str, str]]:
    """What goes before the transforms and after the detections, where it was asked for."""
    chain, tracker = result.scenario.chain, result.scenario.tracker
    rows = []
    if chain.mitigation:
        kinds = ", ".join(method.kind().replace("-", " ") for method in chain.mitigation)
        rows.append(("clean-up", kinds))
    if chain.cluster is not None:
        reach = ", ".join(number(cells) for cells in chain.cluster.reach.of_axes[:3])
        rows.append(("clusters, reach in range, velocity, direction", f"{reach} cells"))
    if tracker is not None:
        rows.append(("tracks", f"{tracker.filter} filter, {tracker.association} association"))
        hits, frames = tracker.confirm_after
        rows.append(
            ("confirmed, dropped", f"{hits} in {frames} frames, {tracker.drop_after} without")
        )
    return rows


def _db(ratio: float) -> str:
    return f"{fixed(ratio_db(ratio), 1)} dB"
