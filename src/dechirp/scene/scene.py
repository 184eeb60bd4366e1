"""The scene: what there is, and where its scatterers are, seen from the radar."""

from collections import Counter
from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import instances
from dechirp.core.displayed import Displayed, Table, cut, settings, several
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import AspectBody, Body
from dechirp.scene.ego import Ego
from dechirp.scene.rotations import about_z, into, out_of
from dechirp.scene.target import Fluctuation, Target


class Parabolas(NamedTuple):
    """Scatterers that go along parabolas, or straight lines, past a radar that does not turn."""

    scatterers: np.ndarray
    """(n,), places in the list of all scatterers."""
    terms_m: np.ndarray
    """(2 or 3, n, 3): the sum of terms_m[k] t^k is where they are, radar coordinates."""


class _Motions(NamedTuple):
    """How the targets move, each (n_targets, 3): fields of the targets as arrays."""

    start_m: np.ndarray
    """From where the radar is at time zero: so the digits of short ways stay."""
    velocity_m_per_s: np.ndarray
    acceleration_m_per_s2: np.ndarray


@value
class Scene(Displayed):
    """Targets, and the radar's own motion.

    Scatterers are counted through: those of the first target, a point or a body of many,
    then those of the next.
    """

    targets: tuple[Target, ...] = ()
    ego: Ego = Ego()

    def __post_init__(self) -> None:
        fix = "Write targets=[Target(...)], also for one alone."
        targets = instances("Scene.targets", self.targets, Target, fix=fix)
        object.__setattr__(self, "targets", targets)
        if not isinstance(self.ego, Ego):
            raise InvalidSetting(
                "Scene.ego",
                got=self.ego,
                need="an Ego",
                fix="Write ego=Ego(velocity_m_per_s=(10, 0, 0)), or leave it out.",
            )
        for name, times in Counter(self.names).items():
            if times > 1:
                raise InvalidSetting(
                    "Scene.targets",
                    got=f"{times} targets named {name}",
                    need="a name for each target alone",
                    fix="Rename one of them.",
                )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each target, given or from its place: target-1, target-2 ..."""
        return tuple(
            target.name or f"target-{number}" for number, target in enumerate(self.targets, 1)
        )

    def target(self, name: str | None) -> Target:
        """The target of that name; without a name, the only one there is."""
        if name is None and len(self.targets) == 1:
            return self.targets[0]
        if name not in self.names:
            raise InvalidSetting(
                "target",
                got=name or "not given",
                need=f"one of {', '.join(self.names) or 'no targets: the scene is empty'}",
                fix="Name the target that is meant.",
            )
        return self.targets[self.names.index(name)]

    @property
    def n_scatterers(self) -> int:
        """Scatterers of all targets."""
        return len(self.owners)

    @cached_property
    def owners(self) -> np.ndarray:
        """Which target each scatterer is of, its place in the list, (n_scatterers,)."""
        return _kept(np.repeat(np.arange(len(self.targets)), self._counts))

    @cached_property
    def fixed_rcs_m2(self) -> np.ndarray:
        """Mean cross section of each scatterer, (n_scatterers,); 0 where it varies with aspect."""
        own_m2 = [target.rcs_m2 if target.rcs_table is None else 0.0 for target in self.targets]
        found = np.repeat(np.array(own_m2), self._counts)
        stops = np.cumsum(self._counts)
        for place in np.flatnonzero(self._has_body).tolist():
            own = slice(stops[place] - self._counts[place], stops[place])
            found[own] = self._body(place).cross_sections_m2()
        wrong = np.flatnonzero(~(np.isfinite(found) & (found >= 0)))
        if wrong.size:
            raise InvalidSetting(
                f"scene.targets.{self.names[self.owners[wrong[0]]]}.body",
                got=f"a body with a cross section of {found[wrong[0]]:g} m^2",
                need="cross sections that are finite, 0 or more",
                fix="Correct what the body gives.",
            )
        return _kept(found)

    @cached_property
    def over_aspect(self) -> np.ndarray:
        """Places of the targets whose cross section varies with aspect."""
        varies = [t.rcs_table is not None or isinstance(t.body, AspectBody) for t in self.targets]
        return _kept(np.flatnonzero(varies))

    @cached_property
    def fluctuating(self) -> dict[Fluctuation, np.ndarray]:
        """Scatterers of each kind of fluctuation, the steady ones left out."""
        kinds = np.array([target.fluctuation for target in self.targets], dtype=str)
        kinds = kinds[self.owners]
        places = {kind: np.flatnonzero(kinds == kind) for kind in get_args(Fluctuation)[1:]}
        return {kind: _kept(found) for kind, found in places.items() if found.size}

    @cached_property
    def accelerates(self) -> np.ndarray:
        """Whether each target is accelerated at a constant rate, (n_targets,)."""
        return _kept((self._motions.acceleration_m_per_s2 != 0).any(axis=1))

    @property
    def is_uniform(self) -> bool:
        """Whether all go on straight lines at constant speed, and the radar too."""
        return not (self.wanderers.size or self.accelerates.any())

    @cached_property
    def parabolas(self) -> Parabolas:
        """The scatterers whose paths are polynomials of time; a car's wheels are not."""
        chosen = np.flatnonzero(self._is_straight)
        scatterers = np.flatnonzero(self._is_straight[self.owners])
        moving, still_s = self._motions, np.zeros(1)
        axes = self.ego.axes(still_s)
        slopes = [moving.velocity_m_per_s[chosen] - np.array(self.ego.velocity_m_per_s)]
        if self.accelerates[chosen].any():
            slopes.append(moving.acceleration_m_per_s2[chosen] / 2)
        terms_m = [self.positions_m(still_s, chosen)[0]]
        for slope in slopes:
            seen = into(axes, slope[None])[0]
            terms_m.append(np.repeat(seen, self._counts[chosen], axis=0))
        return Parabolas(_kept(scatterers), _kept(np.array(terms_m)))

    @cached_property
    def wanderers(self) -> np.ndarray:
        """The scatterers, places in the list, that do not go along parabolas."""
        return _kept(np.flatnonzero(~self._is_straight[self.owners]))

    def positions_m(self, times_s: ArrayLike, targets: np.ndarray | None = None) -> np.ndarray:
        """Where scatterers are, in the coordinates of the radar at each time.

        Parameters
        ----------
        times_s : array (n_times,), s
            Since the start of the first frame.
        targets : array of int, optional
            Places of the targets whose scatterers are meant; all without it.

        Returns
        -------
        array (n_times, n_scatterers, 3), m
            Exact to some roundings of the largest coordinate.
        """
        times_s = np.asarray(times_s, dtype=float)
        chosen = np.arange(len(self.targets)) if targets is None else targets
        counts = self._counts[chosen]
        at_m = np.repeat(self.from_radar_m(times_s, chosen), counts, axis=1)
        stops = np.cumsum(counts)
        for place in np.flatnonzero(self._has_body[chosen]):
            own = slice(stops[place] - counts[place], stops[place])
            at_m[:, own] += self._offsets_m(int(chosen[place]), times_s)
        return into(self.ego.axes(times_s), at_m)

    def target_positions_m(self, times_s: ArrayLike) -> np.ndarray:
        """Where the targets are, bodies by their origins, (n_times, n_targets, 3).

        In the coordinates of the radar at each time.
        """
        return into(self.ego.axes(np.asarray(times_s, dtype=float)), self.from_radar_m(times_s))

    def target_velocities_m_per_s(self, times_s: ArrayLike) -> np.ndarray:
        """Velocities of the targets less that of the radar, (n_times, n_targets, 3).

        Along the axes of the radar, whose turning is left out: the component along the line
        of sight is the rate of change of range.
        """
        times_s = np.asarray(times_s, dtype=float)
        moving = self._motions
        gained = times_s[:, None, None] * moving.acceleration_m_per_s2
        velocities = moving.velocity_m_per_s + gained
        for place in self._on_courses:
            velocities[:, place] = self.targets[place].velocities_at_m_per_s(times_s)
        velocities -= self.ego.velocities_m_per_s(times_s)[:, None]
        return into(self.ego.axes(times_s), velocities)

    def from_radar_m(self, times_s: ArrayLike, targets: np.ndarray | None = None) -> np.ndarray:
        """From the radar to targets, along the axes of the scene, (n_times, n_targets, 3).

        To all without `targets`, their places in the list.
        """
        times_s = np.asarray(times_s, dtype=float)
        chosen = np.arange(len(self.targets)) if targets is None else targets
        moving, t = self._motions, times_s[:, None, None]
        at_m = moving.start_m[chosen] + t * moving.velocity_m_per_s[chosen]
        if self.accelerates[chosen].any():
            at_m += t**2 / 2 * moving.acceleration_m_per_s2[chosen]
        for place in np.flatnonzero(np.isin(chosen, self._on_courses)):
            # Its velocity and acceleration are zero.
            at_m[:, place] += self.targets[chosen[place]].ways_m(times_s)
        return at_m - self.ego.ways_m(times_s)[:, None]

    def _line(self) -> str:
        few = self.names if len(self.names) <= 4 else (*self.names[:3], "...")
        named = f": {', '.join(few)}" if few else ""
        moving = ", a radar that moves" if any(self.ego.velocity_m_per_s) else ""
        return f"{several(len(self.targets), 'target')}{named}{moving}"

    def _tables(self) -> Iterable[Table]:
        rows = ((name, *one._cells()) for name, one in zip(self.names, self.targets, strict=True))
        head = ("name", "position", "velocity", "reflects")
        yield cut("Targets", rows, len(self.targets), head)
        if self.ego != Ego():
            yield settings(self.ego, "The radar's own motion")

    def _body(self, target: int) -> Body:
        body = self.targets[target].body
        assert body is not None
        return body

    def _offsets_m(self, target: int, times_s: np.ndarray) -> np.ndarray:
        """From a target to the scatterers of its body, (n_times, n, 3), axes of the scene."""
        offsets_m = self._body(target).offsets_m(times_s)
        shape = (len(times_s), int(self._counts[target]), 3)
        if offsets_m.shape != shape or not np.isfinite(offsets_m).all():
            raise InvalidSetting(
                f"scene.targets.{self.names[target]}.body",
                got="a body with places that are not finite"
                if offsets_m.shape == shape
                else f"a body with places of the shape {offsets_m.shape}",
                need=f"finite places of the shape {shape}",
                fix="Correct what the body gives.",
            )
        return out_of(about_z(self.targets[target].headings_at_rad(times_s)), offsets_m)

    @cached_property
    def _motions(self) -> _Motions:
        fields = ("position_m", "velocity_m_per_s", "acceleration_m_per_s2")
        start_m, *rates = (
            np.array([getattr(target, field) for target in self.targets]).reshape(-1, 3)
            for field in fields
        )
        return _Motions(start_m - np.array(self.ego.position_m), *rates)

    @cached_property
    def _on_courses(self) -> np.ndarray:
        """Places of the targets that go through waypoints."""
        return np.flatnonzero([bool(target.waypoints) for target in self.targets])

    @cached_property
    def _is_straight(self) -> np.ndarray:
        """Whether the radar sees all of a target go along parabolas, (n_targets,)."""
        alone = np.array([target.is_straight for target in self.targets], dtype=bool)
        return alone & (not self.ego.is_turning)

    @cached_property
    def _has_body(self) -> np.ndarray:
        return np.array([target.body is not None for target in self.targets], dtype=bool)

    @cached_property
    def _counts(self) -> np.ndarray:
        """Number of scatterers of each target."""
        counts = np.ones(len(self.targets), dtype=int)
        for place in np.flatnonzero(self._has_body).tolist():
            counts[place] = self._body(place).n_scatterers()
            if not counts[place]:
                raise InvalidSetting(
                    f"scene.targets.{self.names[place]}.body",
                    got="a body without scatterers",
                    need="one of at least one",
                    fix="Leave the target out, or correct what the body gives.",
                )
        return counts


def _kept(array: np.ndarray) -> np.ndarray:
    """Make an array that belongs to a frozen value one that cannot be changed."""
    array.flags.writeable = False
    return array
