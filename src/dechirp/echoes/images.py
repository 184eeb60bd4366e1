"""Echoes by way of flat mirrors: from and to images of the antennas.

What goes from an antenna to a scatterer off a mirror goes as far as straight from the image of
the antenna. The way there and the way back are mirrored each by itself: direct-direct,
mirrored-direct, direct-mirrored, mirrored-mirrored. Antennas keep their patterns and look where
the wave leaves or comes in, towards the image of the scatterer.

A way goes once off the ground and once off a wall, at most. An antenna and its image are apart
by a step up for the one and a step aside for the other, by which the mirrors are told again:
impairments that move antennas need not know of each other.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from dechirp.echoes.kernels import choice
from dechirp.echoes.parts import Part, Window, gains
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

NEAREST_M = 0.1
"""No mirror is nearer to an antenna: images are 0.2 m off, antennas out of place by less."""


class Mirror(NamedTuple):
    """A flat mirror in the coordinates of the radar."""

    normal: np.ndarray
    """(3,), of length 1, towards the radar."""
    offset_m: float
    """normal @ p of each place p on it."""

    def distances_m(self, places_m: np.ndarray) -> np.ndarray:
        """Of places (n, 3), (n,): positive on the radar's side."""
        return np.asarray(places_m @ self.normal - self.offset_m)

    def images_m(self, places_m: np.ndarray) -> np.ndarray:
        """Of places (n, 3), (n, 3)."""
        return places_m - 2 * self.distances_m(places_m)[:, None] * self.normal


Coefficients = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Amplitude reflection coefficients, (n,), on the ways from the image of an antenna, (3,), to
places, (n, 3); 0 where there is no way."""


def up(scene: Scene) -> np.ndarray:
    """Unit vector upwards, (3,), along the axes of the radar: the same at all times."""
    return np.asarray(scene.ego.axes(np.zeros(1))[0].T @ np.array([0.0, 0.0, 1.0]))


def mid_run_s(part: Part, window: Window) -> float:
    """Middle of the run of chirps of a part, since time zero."""
    return float(window.start_s + window.starts_s[part.chirps.start] - part.sent.starts_s[0])


def mirrors_between(antenna_m: np.ndarray, image_m: np.ndarray, up: np.ndarray) -> list[Mirror]:
    """Mirrors that lead from an antenna, (3,), to its image: a level and an upright one at most.

    None where the two are nearer to each other than images are.
    """
    way_m = image_m - antenna_m
    rise_m = (way_m @ up) * up
    found = []
    for step_m in (rise_m, way_m - rise_m):
        length_m = np.linalg.norm(step_m)
        if length_m > NEAREST_M:
            normal = -step_m / length_m
            found.append(Mirror(normal, float(normal @ (antenna_m + step_m / 2))))
    return found


def reflected(
    part: Part, mirror: Mirror, coefficients: Coefficients, radar: Radar, up: np.ndarray
) -> Iterator[Part]:
    """Give a part, and the copies of it that a mirror adds: three at most.

    Scatterers are mirrored where they are at the middle of the run of chirps, those behind the
    mirror are not. Ways that were mirrored before by one as upright or as level as this stay
    as they are.
    """
    yield part
    there, back = (
        _mirrored(part, which, mirror, coefficients, radar, up) for which in ("tx", "rx")
    )
    for copy in (
        there and there.on(part),
        back and back.on(part),
        there and back and back.on(there.on(part)),
    ):
        if copy is not None and (seen := _seen(copy)).any():
            yield copy._replace(scatterers=choice.some(copy.scatterers, seen))


class _Way(NamedTuple):
    """Mirrored ways between all antennas of a kind, tx or rx, and all scatterers of a part."""

    which: str
    antennas_m: np.ndarray
    """(n_antennas, 3), images."""
    gains: np.ndarray
    """(n_antennas, n_scatterers)."""
    coefficients: np.ndarray
    """(n_scatterers,)."""

    def on(self, part: Part) -> Part:
        """The part by these ways."""
        scatterers, sent = part.scatterers, part.sent
        scatterers = scatterers._replace(amplitudes=scatterers.amplitudes * self.coefficients)
        if self.which == "tx":
            scatterers = scatterers._replace(tx_gains=self.gains)
            sent = sent._replace(tx_m=self.antennas_m)
        else:
            scatterers = scatterers._replace(rx_gains=self.gains)
            sent = sent._replace(rx_m=self.antennas_m)
        return part._replace(scatterers=scatterers, sent=sent)


def _mirrored(
    part: Part,
    which: str,
    mirror: Mirror,
    coefficients: Coefficients,
    radar: Radar,
    up: np.ndarray,
) -> _Way | None:
    own_m = np.array(getattr(radar.array, f"{which}_m"))
    now_m: np.ndarray = getattr(part.sent, f"{which}_m")
    before = mirrors_between(own_m[0], now_m[0], up)
    if any(_is_level(other, up) == _is_level(mirror, up) for other in before):
        return None
    images_m, places_m = mirror.images_m(now_m), part.scatterers.path_m[0]
    reflect = coefficients(images_m.mean(axis=0), places_m)
    seen_m = mirror.images_m(places_m)
    for other in before:
        seen_m = other.images_m(seen_m)
    return _Way(
        which,
        images_m,
        gains(seen_m, radar)[0 if which == "tx" else 1],
        np.where(mirror.distances_m(places_m) > 0, reflect, 0.0),
    )


def _is_level(mirror: Mirror, up: np.ndarray) -> bool:
    return bool(abs(mirror.normal @ up) > 0.5)


def _seen(part: Part) -> np.ndarray:
    """Which scatterers send anything back, (n,)."""
    amplitudes, tx_gains, rx_gains = part.scatterers[1:4]
    return np.asarray((amplitudes != 0) & tx_gains.any(axis=0) & rx_gains.any(axis=0))
