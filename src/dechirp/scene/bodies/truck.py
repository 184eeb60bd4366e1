"""A truck: a tractor with its semitrailer."""

from dechirp.core.values import value
from dechirp.scene.bodies.vehicle import Vehicle


@value
class Truck(Vehicle):
    """A box of some 200 scatterers on five axles, its cross section a car's in proportion to areas.

    As long, wide and high as the European Union allows (directive 96/53/EC). The origin is on the
    ground, under the middle; all goes straight on. See `Vehicle` for the model.
    """

    length_m: float = 16.5
    width_m: float = 2.55
    height_m: float = 4.0
    wheel_radius_m: float = 0.52
    """Of the tyres: their points touch the ground."""
    speed_m_per_s: float = 0.0
    """Of the wheels over the ground, positive forwards: they turn by it, and stand at 0. Where
    the whole goes, its target's velocity says."""

    @property
    def axles(self) -> tuple[float, ...]:
        """Where the axles are: 0 at the tail, 1 at the nose."""
        return (0.15, 0.23, 0.31, 0.685, 0.915)
