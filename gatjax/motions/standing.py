"""What a motion must know of a NAO on its feet."""

from __future__ import annotations

from gatjax.motions.menu import Limbs
from gatjax.records import JOINTS
from gatjax.robot import nao
from gatjax.task import pose
from gatjax.walk.parameters import THETA0


def standing_nao() -> Limbs:
    """Return what a motion must know of a NAO that stands ready."""
    return Limbs(
        names=JOINTS,
        limits=nao.LIMITS,
        home=pose(THETA0),
        speed=nao.SPEEDS,
        floating=True,
    )
