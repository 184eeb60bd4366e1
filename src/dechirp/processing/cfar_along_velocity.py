"""Training cells along velocity alone, and the options of the command line that choose them."""

from contextlib import suppress
from dataclasses import replace

from dechirp.core.errors import InvalidSetting
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar


def cfar_along_velocity(chain: Chain, radar: Radar) -> Cfar | None:
    """Return the detector with training cells along velocity.

    None for too few velocities, or if the estimator needs training cells along range. The guard of
    the default window, or half of the cells of a small map; as many training cells.
    """
    transform = chain.doppler_transform(radar.frame)
    default_cfar = Chain.cfar
    half = (transform.n_bins - 1) // 2
    half = min(half, default_cfar.n_training.velocity + default_cfar.n_guard.velocity)
    guard = min(default_cfar.n_guard.velocity, half // 2)
    if guard == half or guard < transform.main_lobe_half_width_bins - 1:
        return None  # the main lobe of an echo would raise its own threshold
    with suppress(InvalidSetting):  # of the estimator, for want of training cells
        return replace(
            chain.cfar,
            n_training=Cells(range=0, velocity=half - guard),
            n_guard=Cells(range=0, velocity=guard),
        )
    return None


def training_cell_options(cfar: Cfar, setting: str) -> tuple[str, ...]:
    """Return the cells of a detector as PATH=VALUE, `setting` the path of the detector."""
    return tuple(
        f"{setting}.{name}.{axis}={getattr(getattr(cfar, name), axis)}"
        for name in ("n_training", "n_guard")
        for axis in ("range", "velocity")
    )
