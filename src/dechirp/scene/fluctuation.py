"""Fluctuation of cross sections by Swerling's cases 1 to 4."""

import numpy as np

from dechirp.scene.scene import Scene

# Shape of the gamma distribution, and whether it is drawn for each chirp: many scatterers of
# similar size (exponential), or one dominant among many (chi-square with 4 degrees of freedom).
_GAMMA_SHAPES = {
    "swerling-1": (1.0, False),
    "swerling-2": (1.0, True),
    "swerling-3": (2.0, False),
    "swerling-4": (2.0, True),
}


def draw_fluctuation_factors(
    scene: Scene, n_chirps: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray | None]:
    """Draw the ratios of cross sections to their means for one frame.

    Scatterers are independent.

    Parameters
    ----------
    scene : Scene
        Specifies the fluctuation of its targets.
    n_chirps : int
        Number of chirps of the frame.
    rng : Generator
        Not used if all targets are steady.

    Returns
    -------
    per_frame : array (n_scatterers,)
        1 for steady scatterers and those drawn for each chirp.
    per_chirp : array (n_chirps, n_scatterers), or None
        In the order sent, 1 for scatterers not drawn for each chirp; None if there are no others.

    References
    ----------
    P. Swerling, Probability of detection for fluctuating targets, 1954 (IRE Trans. IT-6, 1960).
    """
    per_frame, per_chirp = np.ones(scene.n_scatterers), None
    for kind, scatterers in scene.fluctuating_scatterers_by_model.items():
        shape, per_chirp_draw = _GAMMA_SHAPES[kind]
        if not per_chirp_draw:
            per_frame[scatterers] = rng.standard_gamma(shape, scatterers.size) / shape
            continue
        if per_chirp is None:
            per_chirp = np.ones((n_chirps, scene.n_scatterers))
        per_chirp[:, scatterers] = rng.standard_gamma(shape, (n_chirps, scatterers.size)) / shape
    return per_frame, per_chirp
