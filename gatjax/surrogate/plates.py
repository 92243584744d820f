"""The floor under N NAOs in DART: a floor with give.

DART's contact is rigid; E1's floor is not (solref 0.02 s). Below each sole sphere lies
a small plate that follows it as the tangent plane of the height map, and that a spring
and a damper carry. A sphere of 5 mm on a grid of 30 mm touches nothing else.
"""

from __future__ import annotations

import dartpy
import numpy as np

from gatjax.records import FORCE_SENSORS
from gatjax.robot import nao
from gatjax.surrogate.e1 import E1, nominal
from gatjax.surrogate.skeleton import solid
from gatjax.surrogate.start import Floor

SIDE = 0.02  # m, of a plate
MASS = 0.3  # kg [A], little beside the foot's load; its damper needs it at 1 ms
LAID = 2e-4  # m, a plate follows its corner once it is this far (height error 2 um)
STIFFNESS = 4e4  # N/m, E1's soft contact gives 0.2 mm at 8 N, measured in `stiff`
QUARTER = 0.25 * (nao.TOTAL_MASS + E1.extra_mass)  # kg, on one corner of a foot
DAMPING = 2.0 / E1.floor_time_constant * QUARTER  # N s/m, rate of solref
CORNERS = len(FORCE_SENSORS)


class Ground:
    """The eight pieces of floor of each robot, one under each sole corner."""

    def __init__(self, floor: Floor, robots: int) -> None:
        """Build the plates of N robots; `lay` puts them under the soles."""
        model = nominal()
        geoms = [model.geom(name).id for name in FORCE_SENSORS]
        self.floor = floor
        self.corners = model.geom_pos[geoms].reshape(2, -1, 3)  # m, feet's frames
        self.spheres = np.zeros((robots, CORNERS, 3))  # m, world frame
        self.laid = np.full((robots, CORNERS, 3), np.inf)  # when laid last
        self.skeletons = [dartpy.dynamics.Skeleton("floor") for _ in range(robots)]
        self.joints = [_plate(each) for each in self.skeletons for _ in range(CORNERS)]

    def lay(self, turn: np.ndarray, place: np.ndarray) -> None:
        """Move each plate under its sole corner, tangent to the floor there.

        Args:
            turn: of the feet, [N, 2, 3, 3].
            place: of the feet, [N, 2, 3] m, world frame.
        """
        spheres = self.corners @ turn.swapaxes(-1, -2) + place[:, :, None]
        self.spheres = spheres.reshape(self.spheres.shape)
        moved = np.abs(self.spheres - self.laid).max(-1) > LAID
        self.laid[moved] = at = self.spheres[moved]
        height, slope = self.floor.at(at[:, :2])
        at[:, 2] = height
        plates = zip(np.flatnonzero(moved), _tilted(slope), at, strict=True)
        for plate, tilt, where in plates:
            frame = dartpy.math.Isometry3(tilt, where)
            self.joints[plate].setTransformFromParentBodyNode(frame)

    def forces(self, robot: int, contacts: list) -> np.ndarray:
        """Normal forces of a robot's contacts on its sole corners [8], N."""
        force = np.zeros(CORNERS)
        for contact in contacts:
            away = ((self.spheres[robot] - contact.point) ** 2).sum(-1)
            force[np.argmin(away)] += abs(contact.force @ contact.normal)
        return force


def _plate(floor: dartpy.dynamics.Skeleton) -> dartpy.dynamics.PrismaticJoint:
    joint, node = floor.createPrismaticJointAndBodyNodePair()
    joint.setAxis([0.0, 0.0, 1.0])
    joint.setSpringStiffness(0, STIFFNESS)
    joint.setDampingCoefficient(0, DAMPING)
    node.setMass(MASS)
    node.setGravityMode(False)
    box = dartpy.dynamics.BoxShape([SIDE] * 3)
    solid(node, box, np.array([0.0, 0.0, -0.5 * SIDE]))
    return joint


def _tilted(slope: np.ndarray) -> np.ndarray:
    """Frames [M, 3, 3] on slopes [M, 2]; columns along, across and up."""
    x, y = slope[:, 0], slope[:, 1]
    up = 1.0 / np.sqrt(1.0 + x * x + y * y)
    along = 1.0 / np.sqrt(1.0 + x * x)
    turn = np.zeros((len(slope), 3, 3))
    turn[:, 0, 0], turn[:, 2, 0] = along, x * along
    turn[:, 0, 2], turn[:, 1, 2], turn[:, 2, 2] = -x * up, -y * up, up
    turn[:, 0, 1] = -x * y * up * along
    turn[:, 1, 1] = (1.0 + x * x) * up * along
    turn[:, 2, 1] = y * up * along
    return turn
