"""What MuJoCo warns of: a line of ours each kind, and no file of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable

import mujoco

UNSTABLE = "The simulation is unstable"  # what is made of it gatjax says itself


def heed_engine() -> None:
    """Let MuJoCo tell its warnings here instead of in MUJOCO_LOG.TXT."""
    mujoco.set_mju_user_warning(_teller())


def _teller() -> Callable[[str], None]:
    known: set[str] = set()

    def tell(message: str) -> None:
        kind = message.partition(".")[0]
        if UNSTABLE not in message and kind not in known:
            known.add(kind)
            print(f"warning: MuJoCo: {' '.join(message.split())}", file=sys.stderr)

    return tell
