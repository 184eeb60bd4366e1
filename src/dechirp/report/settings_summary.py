"""Summary of the settings of a run: groups of names and values with units."""

from typing import TYPE_CHECKING

from dechirp.core.text import (
    TIMES_SIGN,
    format_fixed,
    format_number,
    format_probability,
    format_with_si_prefix,
    ratio_db,
)
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.patterns.base import Pattern
from dechirp.radar.radar import Radar

if TYPE_CHECKING:
    from dechirp.experiments.run import Result

SettingsGroup = tuple[str, list[tuple[str, str]]]


def format_settings_by_group(result: "Result") -> list[SettingsGroup]:
    """Return the settings of a run in groups."""
    radar = result.radar
    groups = [
        ("Waveform", _format_waveform_settings(radar)),
        ("Derived limits", _format_derived_limits(radar)),
    ]
    if radar.hardware is not None:
        groups.append(("Hardware", _format_hardware_settings(radar)))
    if result.scenario.scene is not None:
        groups.append(("Echoes", _format_echo_simulation_settings(result)))
    groups.append(("Processing", _format_processing_settings(result)))
    return groups


def format_waveform_and_limits(radar: Radar) -> list[tuple[str, str]]:
    """Return the waveform of a radar and the limits that follow from it."""
    return _format_waveform_settings(radar) + _format_derived_limits(radar)


def _format_waveform_settings(radar: Radar) -> list[tuple[str, str]]:
    frame, chirp = radar.frame, radar.frame.chirp
    return [
        ("start frequency", format_with_si_prefix(chirp.start_frequency_hz, "Hz", 6)),
        ("slope", f"{format_number(chirp.slope_hz_per_s / 1e12, 5)} MHz/µs"),
        ("ADC start", format_with_si_prefix(chirp.adc_start_s, "s")),
        ("ramp duration", format_with_si_prefix(chirp.ramp_duration_s, "s", 5)),
        ("samples per chirp", f"{chirp.n_samples}, {chirp.sampling}"),
        ("sample rate", format_with_si_prefix(chirp.sample_rate_hz, "Hz", 5)),
        ("chirps per frame", _format_chirp_count(frame)),
        ("chirp interval", _format_chirp_intervals(frame)),
        *(
            [("transmitters", _format_transmitter_multiplexing(radar))]
            if len(radar.array.tx_m) > 1
            else []
        ),
        ("receivers", f"{radar.array.n_rx}"),
    ]


def _format_chirp_intervals(frame: Frame) -> str:
    intervals_s = [frame.for_frame(index).single_interval_s for index in range(frame.n_intervals)]
    intervals = ", ".join(format_with_si_prefix(interval_s, "s", 5) for interval_s in intervals_s)
    return intervals if len(intervals_s) == 1 else f"{intervals}, frame by frame"


def _format_chirp_count(frame: Frame) -> str:
    if frame.n_slots == 1:
        return f"{frame.n_chirps_total}"
    grouping = (
        "of each transmitter" if frame.tdm_order is not None else f"rounds of {frame.n_slots}"
    )
    if frame.modulation is not None:
        grouping += f", {frame.modulation.kind().replace('-', ' ')}"
    return f"{frame.n_chirps_total}, {frame.n_chirps} {grouping}"


def _format_transmitter_multiplexing(radar: Radar) -> str:
    multiplexing, n = radar.frame.multiplexing, len(radar.array.tx_m)
    assert multiplexing is not None
    if radar.frame.tdm_order is not None:
        return f"{n}, in turns"
    return f"{n}, together: {multiplexing.kind().replace('-', ' ')}"


def _format_derived_limits(radar: Radar) -> list[tuple[str, str]]:
    frame, chirp = radar.frame.for_frame(0), radar.frame.chirp
    velocities = [
        ("velocity resolution", f"{format_number(frame.velocity_resolution_m_per_s)} m/s"),
        ("largest velocity", f"± {format_number(frame.max_velocity_m_per_s, 5)} m/s"),
    ]
    return [
        ("sampled bandwidth", format_with_si_prefix(chirp.sampled_bandwidth_hz, "Hz", 5)),
        ("wavelength at mid-window", format_with_si_prefix(chirp.wavelength_m, "m", 5)),
        ("range resolution", f"{format_number(chirp.range_resolution_m)} m"),
        ("largest range", f"{format_number(chirp.max_range_m, 5)} m"),
        *(velocities if frame.n_chirps > 1 else []),
        ("frame duration", format_with_si_prefix(frame.duration_s, "s")),
        ("integration gain", _format_ratio_in_db(radar.integration_gain)),
    ]


def _format_hardware_settings(radar: Radar) -> list[tuple[str, str]]:
    hardware = radar.require_hardware()
    return [
        ("transmit power", f"{format_fixed(ratio_db(hardware.transmit_power_w) + 30, 1)} dBm"),
        *_format_antenna_gains(hardware),
        ("EIRP", f"{format_fixed(ratio_db(hardware.eirp_w) + 30, 1)} dBm"),
        ("noise figure", _format_ratio_in_db(hardware.noise_factor)),
        ("loss", _format_ratio_in_db(hardware.loss)),
    ]


def _format_antenna_gains(hardware: Hardware) -> list[tuple[str, str]]:
    tx, rx = (
        f"{format_fixed(ratio_db(float(gain)), 1)} dBi"
        for gain in (hardware.tx_gain(), hardware.rx_gain())
    )
    if hardware.tx_pattern is None and hardware.rx_pattern is None:
        return [("antenna gain", tx)]
    return [
        (f"transmit antenna, {_format_antenna_pattern(hardware.tx_pattern)}", tx),
        (f"receive antenna, {_format_antenna_pattern(hardware.rx_pattern)}", rx),
    ]


def _format_antenna_pattern(pattern: Pattern | None) -> str:
    if pattern is None:
        return "isotropic pattern"
    return f"{pattern.kind().replace('-', ' ')}, peak"


_LATE_ECHO_LABELS = {
    "held": "present from the first sample",
    "onset": "start on arrival",
    "tail": "start on arrival, with the tail of the previous chirp",
}


def _format_echo_simulation_settings(result: "Result") -> list[tuple[str, str]]:
    engine, scene = result.scenario.engine, result.scenario.scene
    assert scene is not None
    kernels = result.cube.attrs.get("kernels")
    kernel = f"{engine.kernel}: {kernels}" if kernels else engine.kernel
    tolerance = format_probability(engine.effective_tolerance(result.cube.dtype))
    return [
        ("targets", f"{len(scene.targets)}"),
        ("scatterers", f"{scene.n_scatterers}"),
        ("kernel", kernel),
        ("tolerance", f"{tolerance} of the RMS value"),
        ("late echoes", _LATE_ECHO_LABELS[engine.late]),
    ]


def _format_processing_settings(result: "Result") -> list[tuple[str, str]]:
    chain, chirp = result.scenario.chain, result.radar.frame.chirp
    cfar = chain.cfar
    sizes = result.power.sizes
    rows = [
        ("range window", chain.range_window),
        ("Doppler window", chain.doppler_window),
        ("map", f"{sizes['range']} ranges {TIMES_SIGN} {sizes['velocity']} velocities"),
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
        rows.append(
            (
                "false-alarm probability",
                f"{format_probability(cfar.false_alarm_probability)} per cell",
            )
        )
    if cfar.offset is not None:
        rows.append(("threshold over noise", _format_ratio_in_db(cfar.offset)))
    if chain.angle is not None:
        rows.append(("directions", chain.angle.kind().replace("-", " ")))
    if chain.n_range_bins not in (None, chirp.n_samples):
        rows.append(("range transform", f"{chirp.n_samples} samples to {chain.n_range_bins} bins"))
    return rows + _format_mitigation_and_tracking_settings(result)


def _format_mitigation_and_tracking_settings(result: "Result") -> list[tuple[str, str]]:
    """Return the settings of mitigation, clustering and tracking, if present."""
    chain, tracker = result.scenario.chain, result.scenario.tracker
    group_tracker, rows = result.scenario.group_tracker, []
    if chain.mitigation:
        kinds = ", ".join(method.kind().replace("-", " ") for method in chain.mitigation)
        rows.append(("mitigation", kinds))
    if chain.cluster is not None:
        reach = ", ".join(
            format_number(cells) for cells in chain.cluster.reach.as_array_by_axis[:3]
        )
        rows.append(("clusters, reach in range, velocity, direction", f"{reach} cells"))
    if tracker is not None:
        rows.append(("tracks", f"{tracker.filter} filter, {tracker.association} association"))
    if group_tracker is not None:
        size = f"{format_number(group_tracker.size_std_m)} m of expected standard deviation"
        rows.append(("tracks", f"groups of detections, {size}"))
    used_tracker = tracker or group_tracker
    if used_tracker is not None:
        hits, frames = used_tracker.confirm_after
        rows.append(
            (
                "confirmation, deletion",
                f"{hits} in {frames} frames, after {used_tracker.drop_after} misses",
            )
        )
    return rows


def _format_ratio_in_db(ratio: float) -> str:
    return f"{format_fixed(ratio_db(ratio), 1)} dB"
