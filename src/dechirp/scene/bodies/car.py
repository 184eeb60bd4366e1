"""A passenger car."""

from dechirp.core.values import value
from dechirp.scene.bodies.vehicle import Vehicle


@value
class Car(Vehicle):
    """A passenger car of some 80 scatterers: panels, corners, wheel arches, turning wheels.

    Its usual size is that of the car whose cross section over aspect it has (3GPP TR 38.901);
    the origin is on the ground, under the middle. See `Vehicle` for the model.
    """

    length_m: float = 5.0
    width_m: float = 2.0
    height_m: float = 1.6
    wheel_radius_m: float = 0.32
    """Of the tyres: their points touch the ground."""
    speed_m_per_s: float = 0.0
    """Of the wheels over the ground, positive forwards: they turn by it, and stand at 0. Where
    the whole goes, its target's velocity says."""

    @property
    def axles(self) -> tuple[float, ...]:
        """Where the axles are: 0 at the tail, 1 at the nose."""
        return (0.23, 0.81)
