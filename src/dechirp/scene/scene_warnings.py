"""Warnings about a scene, issued before it is simulated."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.radar.angle_table import describe_wide_angle_gap
from dechirp.radar.patterns.table import Table
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, beat_and_doppler_frequencies
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.rcs_table import RcsTable
from dechirp.scene.scene import Scene
from dechirp.scene.shadowing import SHADOWED_LOSS, target_shadow_losses
from dechirp.scene.validity import check_scene_echoes_finite, frames_to_check

# Smaller than the cross section of a grain of dust.
_MIN_RCS_M2 = 1e-12

# Largest number of targets named for each kind of finding; further ones are counted.
_MAX_NAMED_TARGETS = 20

# Largest share of a chirp that a late echo may miss without a finding: 1 dB of its SNR, as the
# coherent gain falls by 20 log10(1 - share). The window and the cells cost as much.
_MAX_MISSED_SHARE = 1 - 10 ** (-1 / 20)


class _ResolvedSpans(NamedTuple):
    """Number of unambiguous velocity spans, about zero, that the processing resolves."""

    n_spans: int
    n_spans_by_ramps: int
    """Spans that the ramps of a single transmitter resolve."""
    method: str


class _SceneSnapshot(NamedTuple):
    """All scatterers at one instant, relative to the radar."""

    scene: Scene
    radar: Radar
    frame_text: str
    position_m: np.ndarray
    """(n_scatterers, 3)."""
    velocity_m_per_s: np.ndarray
    """(n_scatterers, 3), of the target of each."""
    resolved: _ResolvedSpans
    range_velocity: RangeVelocity
    """Range of each scatterer, with the velocity of its target, without motion within the body."""
    is_dark: np.ndarray
    """(n_targets,): true if no part of the target reflects."""
    shadow_losses: np.ndarray
    """(n_targets,): two-way loss in the shadow of other bodies, a power ratio."""


class _FindingCase(NamedTuple):
    """Finding for some scatterers of a scene."""

    is_affected: np.ndarray
    """(n_scatterers,)."""
    make_finding: Callable[[str, int], Finding]
    """Makes the finding from the setting of the target and the index of the scatterer."""


def scene_findings(scene: Scene, radar: Radar, *, n_frames: int = 1) -> list[Finding]:
    """Return findings on a scene before it is simulated.

    Targets that are aliased, have a late echo, are behind, within or around the radar, reflect
    nothing, or are shadowed. An echo is late if it misses samples worth more than 1 dB of its SNR.
    Coincident antennas, codes that are not orthogonal, tables with gaps, and findings of bodies.

    Each kind is reported once per target, for the first frame and scatterer concerned, and names at
    most 20 targets; of late echoes, only the latest is reported. `frames_to_check` selects the
    frames. Velocity aliasing of a part that moves within a body is not reported.

    Raises
    ------
    InvalidSetting
        As `check_scene_echoes_finite`.
    """
    check_scene_echoes_finite(scene, radar, n_frames=n_frames)
    findings: dict[tuple[int, int], Finding] = {}
    n_named: Counter[int] = Counter()
    unnamed: dict[int, set[int]] = {}
    for frame in frames_to_check(scene, n_frames) if scene.targets else ():
        snapshot = _snapshot_scene_at_mid_frame(scene, radar, frame, n_frames)
        for kind, find_case in enumerate(
            (
                _find_aliased_velocities,
                _find_velocities_with_excess_range_migration,
                _find_aliased_ranges,
                _find_latest_late_echo,
                _find_scatterers_behind_radar,
                _find_scatterers_without_antenna_gain,
                _find_scatterers_inside_array,
                _find_bodies_around_radar,
                _find_bodies_without_echo,
                _find_shadowed_targets,
            )
        ):
            case = find_case(snapshot)
            if not case.is_affected.any():  # nearly always
                continue
            scatterers = np.flatnonzero(case.is_affected)
            targets, first = np.unique(
                scene.target_index_of_scatterer[scatterers], return_index=True
            )
            new_targets = [
                (target, scatterer)
                for target, scatterer in zip(
                    targets.tolist(), scatterers[first].tolist(), strict=True
                )
                if (target, kind) not in findings
            ]
            n_free = _MAX_NAMED_TARGETS - n_named[kind]
            for target, scatterer in new_targets[:n_free]:
                setting = f"scene.targets.{scene.names[target]}"
                findings[target, kind] = case.make_finding(setting, scatterer)
            n_named[kind] += len(new_targets[:n_free])
            unnamed.setdefault(kind, set()).update(target for target, _ in new_targets[n_free:])
    by_target = [findings[key] for key in sorted(findings, key=lambda key: key[0])]
    return [
        *_coincident_antenna_findings(radar),
        *_non_orthogonal_code_findings(radar),
        *_frame_interval_findings(radar, n_frames),
        *_angle_table_gap_findings(scene, radar),
        *_findings_reported_by_bodies(scene),
        *by_target,
        *_unlisted_target_count_findings(findings, unnamed),
    ]


def _findings_reported_by_bodies(scene: Scene) -> Iterator[Finding]:
    """Yield the findings of bodies."""
    for name, target in zip(scene.names, scene.targets, strict=True):
        if target.body is not None:
            yield from target.body.unusual_property_findings(f"scene.targets.{name}.body")


def _snapshot_scene_at_mid_frame(
    scene: Scene, radar: Radar, frame: int, n_frames: int
) -> _SceneSnapshot:
    frame_text = "" if n_frames == 1 else f" in frame {frame}"
    resolved = _count_resolved_velocity_spans(radar, frame, n_frames)
    start_s, radar = radar.frame.frame_start_s(frame), radar.for_frame(frame)
    time_s = start_s + radar.frame.mid_frame_s
    position_m = scene.scatterer_positions_at_m(time_s)
    velocity = scene.target_velocities_m_per_s([time_s])[0, scene.target_index_of_scatterer]
    range_m = np.linalg.norm(position_m, axis=-1)
    radial_products = np.einsum("ni,ni->n", position_m, velocity)
    is_dark = np.zeros(len(scene.targets), dtype=bool)
    if scene.aspect_dependent_targets.size:
        wavelength_m = radar.frame.chirp.wavelength_m
        is_dark = target_cross_sections_m2(scene, [time_s], wavelength_m)[0] < _MIN_RCS_M2
    range_velocity = RangeVelocity(range_m, radial_products / range_m)
    losses = target_shadow_losses(scene, np.array([time_s]), radar.frame.chirp.wavelength_m)[0]
    return _SceneSnapshot(
        scene, radar, frame_text, position_m, velocity, resolved, range_velocity, is_dark, losses
    )


def _find_aliased_velocities(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find aliased velocities."""
    frame, resolved = snapshot.radar.frame, snapshot.resolved
    cycles = (
        beat_and_doppler_frequencies(snapshot.range_velocity, snapshot.radar).doppler_hz
        * frame.repetition_s
    )
    span = frame.max_velocity_m_per_s

    def make_finding(setting: str, i: int) -> Finding:
        is_resolved = -0.5 <= cycles[i] / resolved.n_spans < 0.5
        max_velocity = (resolved.n_spans_by_ramps if is_resolved else resolved.n_spans) * span
        return Finding(
            level="note" if is_resolved else "warning",
            setting=f"{setting}.velocity",
            value=_format_aliased_range_velocity(
                snapshot, i, resolved.n_spans_by_ramps if is_resolved else resolved.n_spans
            ),
            expected=f"between -{max_velocity:.4g} and {max_velocity:.4g} m/s to be unambiguous",
            fix=f"no action needed: {resolved.method} resolve velocities up to"
            f" {resolved.n_spans * span:.4g}"
            " m/s, except for detections with an ambiguity_confidence below 0.99"
            if is_resolved
            else "shorten the interval between chirps, or expect the aliased velocity",
        )

    cycles_by_ramps = cycles / resolved.n_spans_by_ramps
    return _FindingCase(
        (frame.n_chirps > 1)
        & (not frame.has_falling_ramps)
        & ((cycles_by_ramps < -0.5) | (cycles_by_ramps >= 0.5)),
        make_finding,
    )


def _count_resolved_velocity_spans(radar: Radar, frame_index: int, n_frames: int) -> _ResolvedSpans:
    """Count the velocity spans resolved by ramps, transmitters or frames; triangles resolve all."""
    frame = radar.frame.for_frame(frame_index)
    by_ramps = 1 if frame.modulation is None else frame.n_resolvable_ambiguities
    across_frames = radar.frame.n_resolvable_ambiguities_across_frames(frame_index)
    if n_frames > 1 and across_frames > 1:
        return _ResolvedSpans(
            across_frames, min(by_ramps, across_frames), "frames with other intervals"
        )
    code, across_m = frame.multiplexing, radar.array.virtual_positions_m[:, 1:]
    if code is not None and not code.non_orthogonal_pairs and np.ptp(across_m, axis=0).any():
        return _ResolvedSpans(
            frame.n_resolvable_ambiguities, 1, "phase differences between transmitters"
        )
    return _ResolvedSpans(by_ramps, by_ramps, "different ramps")


# Range migration, in cells beyond that of the aliased velocity, up to which a map detects echoes.
_MAX_MIGRATION_CELLS = 1.0


def _find_velocities_with_excess_range_migration(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find velocities that are aliased in the maps of triangles, with too much migration."""
    frame, chirp = snapshot.radar.frame, snapshot.radar.frame.chirp
    doppler_hz = beat_and_doppler_frequencies(snapshot.range_velocity, snapshot.radar).doppler_hz
    ambiguities = np.round(doppler_hz * frame.repetition_s)
    cells_per_ambiguity = (
        frame.n_chirps * chirp.sampled_bandwidth_hz / chirp.mean_sampled_frequency_hz
    )
    max_velocity = frame.max_velocity_m_per_s
    return _FindingCase(
        np.full(len(ambiguities), frame.has_falling_ramps and frame.n_chirps > 1)
        & (abs(ambiguities) * cells_per_ambiguity > _MAX_MIGRATION_CELLS),
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.velocity",
            value=f"{_format_range_velocity(_scatterer_range_velocity(snapshot, i))}"
            f"{snapshot.frame_text}, with {abs(ambiguities[i]) * cells_per_ambiguity:.2g} more"
            " range cells of migration within the frame than its aliased velocity in the maps of"
            " rising and falling ramps: its peaks are smeared, and weak ones seldom paired",
            expected=f"between -{max_velocity:.4g} and {max_velocity:.4g} m/s, or at most"
            f" {_MAX_MIGRATION_CELLS:g} cell of migration",
            fix="send fewer chirps, shorten the interval, or reduce the bandwidth",
        ),
    )


def _find_aliased_ranges(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find aliased ranges; where the Doppler frequency is measured, it does not alias them."""
    frame, chirp = snapshot.radar.frame, snapshot.radar.frame.chirp
    beat_hz, doppler_hz = beat_and_doppler_frequencies(snapshot.range_velocity, snapshot.radar)
    has_coupling = frame.n_chirps == 1 or frame.has_falling_ramps
    if not has_coupling:
        beat_hz = beat_hz - doppler_hz
    return _FindingCase(
        (beat_hz < 0) | (beat_hz >= chirp.max_beat_frequency_hz),
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            value=_format_aliased_range_velocity(snapshot, i, snapshot.resolved.n_spans),
            expected=f"between 0 and {chirp.max_range_m:.4g} m,"
            + " range-Doppler coupling included," * has_coupling
            + " to be unambiguous",
            fix="sample faster, lower the slope, or expect the aliased range",
        ),
    )


def _scatterer_range_velocity(snapshot: _SceneSnapshot, i: int) -> RangeVelocity:
    return RangeVelocity(
        snapshot.range_velocity.range_m[i], snapshot.range_velocity.velocity_m_per_s[i]
    )


def _format_aliased_range_velocity(snapshot: _SceneSnapshot, i: int, n_resolved_spans: int) -> str:
    true = _scatterer_range_velocity(snapshot, i)
    aliased = alias_range_velocity(true, snapshot.radar, n_resolved_spans=n_resolved_spans)
    return (
        f"{_format_range_velocity(true)}{snapshot.frame_text} is aliased to"
        f" {_format_range_velocity(aliased)}"
    )


def _format_range_velocity(range_velocity: RangeVelocity) -> str:
    range_m, velocity = float(range_velocity.range_m), float(range_velocity.velocity_m_per_s)
    return f"{range_m:.4g} m" + ("" if np.isnan(velocity) else f" at {velocity:.4g} m/s")


def _find_latest_late_echo(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find the latest echo that misses samples worth 1 dB, since one start time fixes all."""
    chirp = snapshot.radar.frame.chirp
    delay_s = 2 * snapshot.range_velocity.range_m / SPEED_OF_LIGHT
    missed_samples = (delay_s - chirp.adc_start_s) * chirp.sample_rate_hz
    is_late = missed_samples > _MAX_MISSED_SHARE * chirp.n_samples
    n_others = len(np.unique(snapshot.scene.target_index_of_scatterer[is_late])) - 1
    others = f", like those of {n_others} more targets" * (n_others > 0)

    def make_finding(setting: str, i: int) -> Finding:
        n_missed = int(np.ceil(missed_samples[i]))
        missed_text = f"the first {n_missed} samples" if n_missed < chirp.n_samples else "all of it"
        return Finding(
            level="warning",
            setting=f"{setting}.position",
            value=f"echo arrives {delay_s[i] * 1e6:.4g} us after ramp start{snapshot.frame_text},"
            f" sampling begins at {chirp.adc_start_s * 1e6:.4g} us{others}",
            expected="a delay of at most adc_start, so that every sample contains the echo",
            fix=f"start sampling later, or set engine.late to onset to simulate a radar that"
            f" misses {missed_text}",
        )

    is_latest = np.arange(len(delay_s)) == delay_s.argmax()
    return _FindingCase(is_late & is_latest, make_finding)


def _find_scatterers_behind_radar(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find scatterers behind the antennas."""
    x_m = snapshot.position_m[:, 0]
    return _FindingCase(
        x_m < 0,
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            value=f"behind the radar{snapshot.frame_text}, at x = {x_m[i]:.4g} m",
            expected="x above 0, in front of the antennas",
            fix="turn the radar or move the target: without a pattern, antennas have the same gain"
            " behind as ahead",
        ),
    )


def _find_scatterers_without_antenna_gain(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find scatterers ahead, towards which a pattern has no gain."""
    hardware, (x_m, y_m, z_m) = snapshot.radar.hardware, snapshot.position_m.T
    azimuth_rad, elevation_rad = np.arctan2(y_m, x_m), np.arctan2(z_m, np.hypot(x_m, y_m))
    is_outside = np.zeros(len(x_m), dtype=bool)
    for pattern in () if hardware is None else (hardware.tx_pattern, hardware.rx_pattern):
        if pattern is not None:
            is_outside |= (x_m >= 0) & (pattern.gain_towards(azimuth_rad, elevation_rad) == 0)

    def make_finding(setting: str, i: int) -> Finding:
        azimuth, elevation = np.degrees([azimuth_rad[i], elevation_rad[i]])
        return Finding(
            level="warning",
            setting=f"{setting}.position",
            value=f"at azimuth {azimuth:.4g} deg, elevation {elevation:.4g} deg"
            f"{snapshot.frame_text}, where the pattern of the antennas has no gain",
            expected="a direction with transmit and receive gain",
            fix="turn the beam or move the target: it has no echo there",
        )

    return _FindingCase(is_outside, make_finding)


def _find_scatterers_inside_array(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find scatterers between the antennas, or within a wavelength, during the frame."""
    antennas_m = np.array([*snapshot.radar.array.tx_m, *snapshot.radar.array.rx_m])
    low_m, high_m = antennas_m.min(axis=0), antennas_m.max(axis=0)
    min_distance_m = np.linalg.norm(high_m - low_m) / 2 + snapshot.radar.frame.chirp.wavelength_m
    offset_m, velocity = snapshot.position_m - (low_m + high_m) / 2, snapshot.velocity_m_per_s
    # Nearest point on a straight line through mid-frame, within the frame.
    speed2 = np.einsum("ni,ni->n", velocity, velocity)
    half_s = snapshot.radar.frame.duration_s / 2
    nearest_s = -np.einsum("ni,ni->n", offset_m, velocity) / np.where(speed2 > 0, speed2, 1.0)
    nearest_m = offset_m + np.clip(nearest_s, -half_s, half_s)[:, None] * velocity
    distance_m = np.linalg.norm(nearest_m, axis=-1)
    return _FindingCase(
        distance_m < min_distance_m,
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            value=f"inside the array{snapshot.frame_text}, {distance_m[i]:.4g} m from its centre",
            expected=f"beyond {min_distance_m:.4g} m, a wavelength from the outermost antennas,"
            " during the whole frame",
            fix="move the target, or check the unit of its position and of the array",
        ),
    )


def _find_bodies_around_radar(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find bodies with scatterers on all sides of the radar."""
    first = np.flatnonzero(np.diff(snapshot.scene.target_index_of_scatterer, prepend=-1))
    low_m = np.minimum.reduceat(snapshot.position_m, first)
    high_m = np.maximum.reduceat(snapshot.position_m, first)
    # A flat body lies in a plane: level with the radar, it surrounds the radar too.
    is_around = ((low_m < 0) & (high_m > 0))[:, :2].all(axis=1) & (low_m[:, 2] * high_m[:, 2] <= 0)
    return _FindingCase(
        is_around[snapshot.scene.target_index_of_scatterer],
        lambda setting, _: Finding(
            level="warning",
            setting=f"{setting}.body",
            value=f"around the radar{snapshot.frame_text}: scatterers on all sides of it",
            expected="a radar outside of the body",
            fix="move the target, or remove the parts of the body that carry the radar",
        ),
    )


def _find_bodies_without_echo(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find bodies that do not reflect towards the radar."""
    return _FindingCase(
        snapshot.is_dark[snapshot.scene.target_index_of_scatterer],
        lambda setting, _: Finding(
            level="warning",
            setting=f"{setting}.heading",
            value=f"a heading without any reflection towards the radar{snapshot.frame_text}",
            expected="a reflecting side towards the radar",
            fix="turn the target: without a heading it faces its direction of motion, or x at rest",
        ),
    )


def _find_shadowed_targets(snapshot: _SceneSnapshot) -> _FindingCase:
    """Find targets in the shadow of other bodies."""
    losses, targets = snapshot.shadow_losses, snapshot.scene.target_index_of_scatterer
    return _FindingCase(
        losses[targets] > SHADOWED_LOSS,
        lambda setting, i: Finding(
            level="note",
            setting=f"{setting}.position",
            value=f"in the shadow of other bodies{snapshot.frame_text}: its echo is"
            f" {to_decibels(losses[targets[i]]):.3g} dB weaker",
            expected=f"a loss below {to_decibels(SHADOWED_LOSS):.3g} dB to count as visible",
            fix="nothing, if it is hidden; else set scene.shadowing to false",
        ),
    )


def _coincident_antenna_findings(radar: Radar) -> Iterator[Finding]:
    names = {"tx": "transmitters", "rx": "receivers"}
    for kind, first, second in radar.array.find_coincident_elements():
        yield Finding(
            level="warning",
            setting=f"radar.array.{kind}",
            value=f"{names[kind]} {first} and {second} are at the same position",
            expected=f"different positions of the {names[kind]}",
            fix="move one of them: coincident antennas add no information",
        )


def _non_orthogonal_code_findings(radar: Radar) -> Iterator[Finding]:
    code = radar.frame.multiplexing
    pairs = code.non_orthogonal_pairs if code is not None else ()
    if pairs:
        first, second = pairs[0]
        more_text = f", and {len(pairs) - 1} more pairs," if len(pairs) > 1 else ""
        yield Finding(
            level="warning",
            setting="radar.frame.multiplexing",
            value=f"a code in which transmitters {first} and {second}{more_text} are not orthogonal"
            " over a round: they form a beam",
            expected="orthogonal transmitters, for the SNR of the truth and the link budget",
            fix="expect more gain in the beam and less beside it, or use orthogonal phases",
        )


def _frame_interval_findings(radar: Radar, n_frames: int) -> Iterator[Finding]:
    """Yield a finding if several frame intervals resolve no more than one."""
    intervals_s = radar.frame.interval_s
    if not isinstance(intervals_s, tuple):
        return
    if len(set(intervals_s)) < 2 or n_frames < len(intervals_s):
        few = n_frames < len(intervals_s)
        yield Finding(
            level="warning",
            setting="radar.frame.interval",
            value=f"{len(intervals_s)} intervals for {n_frames} frames"
            if few
            else f"{len(intervals_s)} intervals that are all {intervals_s[0] * 1e6:.5g} us",
            expected="frames with different intervals, whose comparison resolves velocities",
            fix="simulate more frames" if few else "give a single interval, or different ones",
        )


def _angle_table_gap_findings(scene: Scene, radar: Radar) -> Iterator[Finding]:
    """Yield a finding for each gap between the angles of a table."""
    tables: dict[str, object] = {
        f"scene.targets.{scene.names[target_index]}.rcs_table": scene.targets[
            target_index
        ].rcs_table
        for target_index in scene.aspect_dependent_targets
    }
    if radar.hardware is not None:
        for name in ("tx_pattern", "rx_pattern"):
            tables[f"radar.hardware.{name}"] = getattr(radar.hardware, name)
    for setting, table in tables.items():
        if not isinstance(table, RcsTable | Table):
            continue
        for axis in ("azimuth", "elevation"):
            gap = describe_wide_angle_gap(getattr(table, f"{axis}_rad"))
            if gap:
                yield Finding(
                    level="warning",
                    setting=f"{setting}.{axis}",
                    value=f"a gap {gap}",
                    expected="angles without a gap, in which values are interpolated in decibels",
                    fix="measure there, or add known values",
                )


def _unlisted_target_count_findings(
    findings: dict[tuple[int, int], Finding], unnamed: dict[int, set[int]]
) -> Iterator[Finding]:
    """Yield the number of targets that are not named, for each kind of finding."""
    for kind, targets in unnamed.items():
        number = len(targets - {target for target, k in findings if k == kind})
        if number:
            example = next(finding for (_, k), finding in findings.items() if k == kind)
            yield Finding(
                level="warning",
                setting="scene.targets",
                value=f"{number} more like {example.setting}: {example.value}",
                expected=example.expected,
                fix=example.fix,
            )
