"""Echoes that fade and flare: Swerling's cases 1 to 4."""

import numpy as np

from dechirp.scene.scene import Scene

# Shape of the gamma variate, and whether it is drawn for each chirp: many scatterers of like
# size (exponential), or one strong among many (chi-square with 4 degrees of freedom).
_KINDS = {
    "swerling-1": (1.0, False),
    "swerling-2": (1.0, True),
    "swerling-3": (2.0, False),
    "swerling-4": (2.0, True),
}


def power_factors(
    scene: Scene, n_chirps: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray | None]:
    """Cross sections of one frame over their means, drawn for each scatterer by itself.

    Parameters
    ----------
    scene : Scene
        Tells how its targets fluctuate.
    n_chirps : int
        All chirps that the frame sends.
    rng : Generator
        Nothing is drawn from it where all targets are steady.

    Returns
    -------
    per_frame : array (n_scatterers,)
        1 where steady or drawn for each chirp.
    per_chirp : array (n_chirps, n_scatterers), or None
        In the order sent, 1 where not drawn for each chirp; None where nothing is.

    References
    ----------
    P. Swerling, Probability of detection for fluctuating targets, 1954 (IRE Trans. IT-6, 1960).
    """
    per_frame, per_chirp = np.ones(scene.n_scatterers), None
    for kind, places in scene.fluctuating.items():
        shape, in_each_chirp = _KINDS[kind]
        if not in_each_chirp:
            per_frame[places] = rng.standard_gamma(shape, places.size) / shape
            continue
        if per_chirp is None:
            per_chirp = np.ones((n_chirps, scene.n_scatterers))
        per_chirp[:, places] = rng.standard_gamma(shape, (n_chirps, places.size)) / shape
    return per_frame, per_chirp
