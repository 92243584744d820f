"""A menu of safe motions that make the faults of a robot visible; numpy only."""

from gatjax.motions.menu import MENU, Limbs, Motion, chosen, motion

__all__ = ["MENU", "Limbs", "Motion", "chosen", "motion"]
