"""What in a scene surprises, told before it is simulated."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.directions import hole
from dechirp.radar.patterns.table import TablePattern
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, folded, frequencies
from dechirp.scene.possible import looked_at, must_be_possible
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.rcs_table import RcsTable
from dechirp.scene.scene import Scene

# Less is sent back by a grain of dust.
_DARK_M2 = 1e-12

# Targets that each kind of surprise is told of by name; of more of them, the number.
_MOST_TOLD = 20


class _Told(NamedTuple):
    """Folds of the velocity about zero that are told apart, in all."""

    n_folds: int
    by_ramps: int
    """Those of them that the ramps of one transmitter tell."""
    by: str


class _View(NamedTuple):
    """All scatterers at one instant, seen from the radar."""

    scene: Scene
    radar: Radar
    when: str
    position_m: np.ndarray
    """(n_scatterers, 3)."""
    velocity_m_per_s: np.ndarray
    """(n_scatterers, 3), of the target of each."""
    told: _Told
    place: Place
    """Of each: with the velocity of its target, without that of a part that moves in it."""
    is_dark: np.ndarray
    """(n_targets,): whether nothing of a target sends anything back."""


class _Surprise(NamedTuple):
    """One kind of surprise: which scatterers it befalls, and what is said of one."""

    befalls: np.ndarray
    """(n_scatterers,)."""
    finding: Callable[[str, int], Finding]
    """Of the setting of its target, and its place in the list."""


def surprises(scene: Scene, radar: Radar, *, n_frames: int = 1) -> list[Finding]:
    """Targets that fold, echo late, or are behind, within or around the radar, or dark.

    Antennas that are alike, codes that mix, tables with holes, and what bodies say of themselves.

    Each kind is told once of a target, of the first frame and scatterer that it befalls, and
    by name of 20 targets at most; of echoes that come late, of the latest alone. See `looked_at`
    for the frames. A part that moves within a body may fold in velocity unsaid.

    Raises
    ------
    InvalidSetting
        As `must_be_possible`.
    """
    must_be_possible(scene, radar, n_frames=n_frames)
    told: dict[tuple[int, int], Finding] = {}
    n_told: Counter[int] = Counter()
    others: dict[int, set[int]] = {}
    for frame in looked_at(scene, n_frames) if scene.targets else ():
        view = _view(scene, radar, frame, n_frames)
        for kind, find in enumerate(
            (_fast, _smeared, _folding, _late, _behind, _unseen, _within, _around, _dark)
        ):
            surprise = find(view)
            scatterers = np.flatnonzero(surprise.befalls)
            targets, first = np.unique(scene.owners[scatterers], return_index=True)
            new = [
                (target, scatterer)
                for target, scatterer in zip(
                    targets.tolist(), scatterers[first].tolist(), strict=True
                )
                if (target, kind) not in told
            ]
            room = _MOST_TOLD - n_told[kind]
            for target, scatterer in new[:room]:
                setting = f"scene.targets.{scene.names[target]}"
                told[target, kind] = surprise.finding(setting, scatterer)
            n_told[kind] += len(new[:room])
            others.setdefault(kind, set()).update(target for target, _ in new[room:])
    by_target = [told[key] for key in sorted(told, key=lambda key: key[0])]
    return [
        *_like_elements(radar),
        *_mixed(radar),
        *_in_turn(radar, n_frames),
        *_holes(scene, radar),
        *_in_bodies(scene),
        *by_target,
        *_more(told, others),
    ]


def _in_bodies(scene: Scene) -> Iterator[Finding]:
    """What bodies say of themselves."""
    for name, target in zip(scene.names, scene.targets, strict=True):
        if target.body is not None:
            yield from target.body.findings(f"scene.targets.{name}.body")


def _view(scene: Scene, radar: Radar, frame: int, n_frames: int) -> _View:
    when = "" if n_frames == 1 else f" in frame {frame}"
    told = _told(radar, frame, n_frames)
    start_s, radar = radar.frame.start_s(frame), radar.at(frame)
    time_s = [start_s + radar.frame.mid_frame_s]
    position_m = scene.positions_m(time_s)[0]
    velocity = scene.target_velocities_m_per_s(time_s)[0, scene.owners]
    range_m = np.linalg.norm(position_m, axis=-1)
    along = np.einsum("ni,ni->n", position_m, velocity)
    is_dark = np.zeros(len(scene.targets), dtype=bool)
    if scene.over_aspect.size:
        wavelength_m = radar.frame.chirp.wavelength_m
        is_dark = target_cross_sections_m2(scene, time_s, wavelength_m)[0] < _DARK_M2
    place = Place(range_m, along / range_m)
    return _View(scene, radar, when, position_m, velocity, told, place, is_dark)


def _fast(view: _View) -> _Surprise:
    """Velocities that fold."""
    frame, told = view.radar.frame, view.told
    turns = frequencies(view.place, view.radar).doppler_hz * frame.repetition_s
    span = frame.max_velocity_m_per_s

    def finding(setting: str, i: int) -> Finding:
        is_told = -0.5 <= turns[i] / told.n_folds < 0.5
        most = (told.by_ramps if is_told else told.n_folds) * span
        return Finding(
            level="note" if is_told else "warning",
            setting=f"{setting}.velocity",
            got=_folds(view, i, told.by_ramps if is_told else told.n_folds),
            need=f"between -{most:.4g} and {most:.4g} m/s to be unambiguous",
            fix=f"Nothing is to be done: {told.by} tell velocities up to {told.n_folds * span:.4g}"
            " m/s; detections are unfolded, but for those with a fold_confidence below 0.99."
            if is_told
            else "Shorten the interval between chirps, or read the folded velocity.",
        )

    turns_told = turns / told.by_ramps
    return _Surprise(
        (frame.n_chirps > 1) & (not frame.falls) & ((turns_told < -0.5) | (turns_told >= 0.5)),
        finding,
    )


def _told(radar: Radar, index: int, n_frames: int) -> _Told:
    """Folds in a frame that ramps, transmitters or other frames tell; triangles tell all."""
    frame = radar.frame.at(index)
    by_ramps = 1 if frame.modulation is None else frame.n_folds
    in_turn = radar.frame.n_folds_in_turn(index)
    if n_frames > 1 and in_turn > 1:
        return _Told(in_turn, min(by_ramps, in_turn), "frames of other intervals")
    code, across_m = frame.multiplexing, radar.array.virtual_m[:, 1:]
    if code is not None and not code.mixed and np.ptp(across_m, axis=0).any():
        return _Told(frame.n_folds, 1, "transmitters, by how they turn against each other,")
    return _Told(by_ramps, by_ramps, "ramps that differ")


# In one map echoes are found that walk through so many cells more than it is made for.
_WALKED = 1.0


def _smeared(view: _View) -> _Surprise:
    """Velocities that fold in the maps of triangles, and walk through them."""
    frame, chirp = view.radar.frame, view.radar.frame.chirp
    doppler_hz = frequencies(view.place, view.radar).doppler_hz
    folds = np.round(doppler_hz * frame.repetition_s)
    a_fold = frame.n_chirps * chirp.sampled_bandwidth_hz / chirp.mean_sampled_frequency_hz
    most = frame.max_velocity_m_per_s
    return _Surprise(
        np.full(len(folds), frame.falls and frame.n_chirps > 1) & (abs(folds) * a_fold > _WALKED),
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.velocity",
            got=f"{_said(_at(view, i))}{view.when}, which walks {abs(folds[i]) * a_fold:.2g} range"
            " cells within the frame more than the velocity to which it folds in the maps of the"
            " rising and of the falling ramps: its peaks are smeared, and seldom pair",
            need=f"between -{most:.4g} and {most:.4g} m/s, or at most {_WALKED:g} cell, not to be"
            " lost",
            fix="Send fewer chirps, shorten the interval, or sweep less.",
        ),
    )


def _folding(view: _View) -> _Surprise:
    """Ranges that fold."""
    chirp = view.radar.frame.chirp
    beat_hz = frequencies(view.place, view.radar).beat_hz
    return _Surprise(
        (beat_hz < 0) | (beat_hz >= chirp.max_beat_frequency_hz),
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            got=_folds(view, i, view.told.n_folds),
            need=f"between 0 and {chirp.max_range_m:.4g} m, range-Doppler coupling included, to"
            " be unambiguous",
            fix="Sample faster or lower the slope, or read the folded range.",
        ),
    )


def _at(view: _View, i: int) -> Place:
    return Place(view.place.range_m[i], view.place.velocity_m_per_s[i])


def _folds(view: _View, i: int, folds: int) -> str:
    there = _at(view, i)
    found = folded(there, view.radar, folds=folds)
    return f"{_said(there)}{view.when} folds to {_said(found)}"


def _said(place: Place) -> str:
    range_m, velocity = float(place.range_m), float(place.velocity_m_per_s)
    return f"{range_m:.4g} m" + ("" if np.isnan(velocity) else f" at {velocity:.4g} m/s")


def _late(view: _View) -> _Surprise:
    """Echoes that come after the first sample: told of the latest, as one start mends all."""
    chirp = view.radar.frame.chirp
    delay_s = 2 * view.place.range_m / SPEED_OF_LIGHT
    is_late = delay_s > chirp.adc_start_s
    n_others = len(np.unique(view.scene.owners[is_late])) - 1
    others = f", as for {n_others} more of the targets" * (n_others > 0)

    def finding(setting: str, i: int) -> Finding:
        late = int(np.ceil((delay_s[i] - chirp.adc_start_s) * chirp.sample_rate_hz))
        missed = f"the first {late} samples" if late < chirp.n_samples else "all of it"
        return Finding(
            level="warning",
            setting=f"{setting}.position",
            got=f"echo arrives {delay_s[i] * 1e6:.4g} us after ramp start{view.when}, sampling"
            f" begins at {chirp.adc_start_s * 1e6:.4g} us{others}",
            need="a delay of at most adc_start for every sample to hold the echo",
            fix=f"Start sampling later. A real radar would miss {missed}: set engine.late to"
            " onset for a simulation that does.",
        )

    latest = np.arange(len(delay_s)) == delay_s.argmax()
    return _Surprise(is_late & latest, finding)


def _behind(view: _View) -> _Surprise:
    """Scatterers that the antennas do not look at."""
    x_m = view.position_m[:, 0]
    return _Surprise(
        x_m < 0,
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            got=f"behind the radar{view.when}, at x = {x_m[i]:.4g} m",
            need="x above 0, where the antennas look",
            fix="Turn the radar or move the target: without a pattern, antennas see behind them"
            " as they see ahead.",
        ),
    )


def _unseen(view: _View) -> _Surprise:
    """Scatterers ahead that a pattern has no gain towards."""
    hardware, (x_m, y_m, z_m) = view.radar.hardware, view.position_m.T
    azimuth_rad, elevation_rad = np.arctan2(y_m, x_m), np.arctan2(z_m, np.hypot(x_m, y_m))
    unseen = np.zeros(len(x_m), dtype=bool)
    for pattern in () if hardware is None else (hardware.tx_pattern, hardware.rx_pattern):
        if pattern is not None:
            unseen |= (x_m >= 0) & (pattern.gain_towards(azimuth_rad, elevation_rad) == 0)

    def finding(setting: str, i: int) -> Finding:
        azimuth, elevation = np.degrees([azimuth_rad[i], elevation_rad[i]])
        return Finding(
            level="warning",
            setting=f"{setting}.position",
            got=f"at azimuth {azimuth:.4g} deg, elevation {elevation:.4g} deg{view.when}, where the"
            " pattern of the antennas has no gain",
            need="a direction in which antennas send and receive",
            fix="Turn the beam or move the target: it has no echo there.",
        )

    return _Surprise(unseen, finding)


def _within(view: _View) -> _Surprise:
    """Scatterers that come between the antennas, or within a wavelength, during the frame."""
    antennas_m = np.array([*view.radar.array.tx_m, *view.radar.array.rx_m])
    low_m, high_m = antennas_m.min(axis=0), antennas_m.max(axis=0)
    reach_m = np.linalg.norm(high_m - low_m) / 2 + view.radar.frame.chirp.wavelength_m
    from_m, velocity = view.position_m - (low_m + high_m) / 2, view.velocity_m_per_s
    # Nearest on a straight line through mid-frame, within the frame.
    speed2 = np.einsum("ni,ni->n", velocity, velocity)
    half_s = view.radar.frame.duration_s / 2
    nearest_s = -np.einsum("ni,ni->n", from_m, velocity) / np.where(speed2 > 0, speed2, 1.0)
    nearest_m = from_m + np.clip(nearest_s, -half_s, half_s)[:, None] * velocity
    apart_m = np.linalg.norm(nearest_m, axis=-1)
    return _Surprise(
        apart_m < reach_m,
        lambda setting, i: Finding(
            level="warning",
            setting=f"{setting}.position",
            got=f"inside the array{view.when}, {apart_m[i]:.4g} m from its middle",
            need=f"beyond {reach_m:.4g} m, a wavelength from where the antennas end, in all of the"
            " frame",
            fix="Move the target, or check the unit of its position and of the array.",
        ),
    )


def _around(view: _View) -> _Surprise:
    """Bodies with scatterers on all sides of the radar."""
    first = np.flatnonzero(np.diff(view.scene.owners, prepend=-1))
    low_m = np.minimum.reduceat(view.position_m, first)
    high_m = np.maximum.reduceat(view.position_m, first)
    # A flat body lies in a plane: level with the radar it is around it as well.
    around = ((low_m < 0) & (high_m > 0))[:, :2].all(axis=1) & (low_m[:, 2] * high_m[:, 2] <= 0)
    return _Surprise(
        around[view.scene.owners],
        lambda setting, _: Finding(
            level="warning",
            setting=f"{setting}.body",
            got=f"around the radar{view.when}: scatterers on all sides of it",
            need="a body that the radar is outside of",
            fix="Move the target, or leave out the parts of the body that carry the radar.",
        ),
    )


def _dark(view: _View) -> _Surprise:
    """Bodies that face elsewhere."""
    return _Surprise(
        view.is_dark[view.scene.owners],
        lambda setting, _: Finding(
            level="warning",
            setting=f"{setting}.heading",
            got=f"one with which the radar sees no side that reflects{view.when}",
            need="a side that reflects towards the radar",
            fix="Turn the target: without a heading it faces where it goes, at rest along x.",
        ),
    )


def _like_elements(radar: Radar) -> Iterator[Finding]:
    names = {"tx": "transmitters", "rx": "receivers"}
    for kind, first, second in radar.array.coincident():
        yield Finding(
            level="warning",
            setting=f"radar.array.{kind}",
            got=f"{names[kind]} {first} and {second} are at one place",
            need=f"a place for each of the {names[kind]}",
            fix="Move one of them: two at one place tell the same.",
        )


def _mixed(radar: Radar) -> Iterator[Finding]:
    code = radar.frame.multiplexing
    mixed = code.mixed if code is not None else ()
    if mixed:
        first, second = mixed[0]
        more = f", and {len(mixed) - 1} more pairs," if len(mixed) > 1 else ""
        yield Finding(
            level="warning",
            setting="radar.frame.multiplexing",
            got=f"a code in which transmitters {first} and {second}{more} are not orthogonal over a"
            " round: they form a beam",
            need="orthogonal transmitters for the SNR that the truth and the link budget tell",
            fix="Expect more in the beam and less beside it, or take phases that are orthogonal.",
        )


def _in_turn(radar: Radar, n_frames: int) -> Iterator[Finding]:
    """Intervals in turn that tell no more than one."""
    intervals_s = radar.frame.interval_s
    if not isinstance(intervals_s, tuple):
        return
    if len(set(intervals_s)) < 2 or n_frames < len(intervals_s):
        few = n_frames < len(intervals_s)
        yield Finding(
            level="warning",
            setting="radar.frame.interval",
            got=f"{len(intervals_s)} intervals for {n_frames} frames"
            if few
            else f"{len(intervals_s)} intervals that are all {intervals_s[0] * 1e6:.5g} us",
            need="frames with intervals that differ: velocities unfold by comparing them",
            fix="Simulate more frames." if few else "Give one interval, or others.",
        )


def _holes(scene: Scene, radar: Radar) -> Iterator[Finding]:
    """Tables over directions in which angles are missing."""
    tables: dict[str, object] = {
        f"scene.targets.{scene.names[place]}.rcs_table": scene.targets[place].rcs_table
        for place in scene.over_aspect
    }
    if radar.hardware is not None:
        for name in ("tx_pattern", "rx_pattern"):
            tables[f"radar.hardware.{name}"] = getattr(radar.hardware, name)
    for setting, table in tables.items():
        if not isinstance(table, RcsTable | TablePattern):
            continue
        for axis in ("azimuth", "elevation"):
            missing = hole(getattr(table, f"{axis}_rad"))
            if missing:
                yield Finding(
                    level="warning",
                    setting=f"{setting}.{axis}",
                    got=f"a hole {missing}",
                    need="angles without a hole: in it, values lie on a straight line of decibels",
                    fix="Measure there, or add what is known of it.",
                )


def _more(told: dict[tuple[int, int], Finding], others: dict[int, set[int]]) -> Iterator[Finding]:
    """Count of the targets that are not told of by name."""
    for kind, targets in others.items():
        number = len(targets - {target for target, k in told if k == kind})
        if number:
            one = next(finding for (_, k), finding in told.items() if k == kind)
            yield Finding(
                level="warning",
                setting="scene.targets",
                got=f"{number} more like {one.setting}: {one.got}",
                need=one.need,
                fix=one.fix,
            )
