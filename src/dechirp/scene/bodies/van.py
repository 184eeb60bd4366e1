"""A delivery van."""

from dechirp.core.values import value
from dechirp.scene.bodies.vehicle import Vehicle


@value
class Van(Vehicle):
    """A delivery van of some 90 scatterers: a car's, and its cross section in proportion to areas.

    The origin is on the ground, under the middle. See `Vehicle` for the model.
    """

    length_m: float = 5.9
    width_m: float = 2.0
    height_m: float = 2.6
    wheel_radius_m: float = 0.34
    """Of the tyres: their points touch the ground."""
    speed_m_per_s: float = 0.0
    """Of the wheels over the ground, positive forwards: they turn by it, and stand at 0. Where
    the whole goes, its target's velocity says."""

    @property
    def axles(self) -> tuple[float, ...]:
        """Where the axles are: 0 at the tail, 1 at the nose."""
        return (0.21, 0.83)
