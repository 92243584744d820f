"""A menu of safe motions that make the faults of a robot visible; numpy only."""

from gatjax.motions.menu import MENU, SLOWEST, Limbs, Motion, chosen, motion
from gatjax.motions.standing import standing_nao

__all__ = ["MENU", "SLOWEST", "Limbs", "Motion", "chosen", "motion", "standing_nao"]
