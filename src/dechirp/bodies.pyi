# Written by tests/test_api.py.

from dechirp.scene.bodies.bicyclist import Bicyclist as Bicyclist
from dechirp.scene.bodies.corner_reflector import CornerReflector as CornerReflector
from dechirp.scene.bodies.foliage import Foliage as Foliage
from dechirp.scene.bodies.ground_clutter import GroundClutter as GroundClutter
from dechirp.scene.bodies.guard_rail import GuardRail as GuardRail
from dechirp.scene.bodies.mesh import Mesh as Mesh
from dechirp.scene.bodies.pedestrian import Pedestrian as Pedestrian
from dechirp.scene.bodies.plate import Plate as Plate
from dechirp.scene.bodies.point_cloud import PointCloud as PointCloud
from dechirp.scene.bodies.points import Oscillation as Oscillation
from dechirp.scene.bodies.points import Points as Points
from dechirp.scene.bodies.points import Rotation as Rotation
from dechirp.scene.bodies.points import Scatterer as Scatterer
from dechirp.scene.bodies.pole import Pole as Pole
from dechirp.scene.bodies.sphere import Sphere as Sphere
from dechirp.scene.bodies.vehicle import Car as Car
from dechirp.scene.bodies.vehicle import Truck as Truck
from dechirp.scene.bodies.vehicle import Van as Van
from dechirp.scene.bodies.wall import Wall as Wall
