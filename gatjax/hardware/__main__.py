"""gatjax-deploy: a policy on a robot, from a computer that has only numpy."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gatjax.hardware.deploy import Asked, deploy
from gatjax.hardware.links import FORMS
from gatjax.hardware.session import Stopped
from gatjax.hardware.terminal import Terminal

STOPPED, FAILED = 130, 1  # exit codes: Ctrl-C, an error


def main(arguments: list[str] | None = None) -> int:
    """Deploy; an error is one line. Returns the exit code, 0 only on success."""
    parser = argparse.ArgumentParser(
        prog="gatjax-deploy",
        description="Let a robot walk a policy that gatjax found, under guard. Ctrl-C "
        "or the button on its chest lets it crouch; a second Ctrl-C takes its power.",
    )
    parser.add_argument("policy", type=Path, help="policy JSON of a run, or theta0")
    parser.add_argument("--robot", default="lola", help=FORMS)
    parser.add_argument("--walks", type=int, default=1, help="how many")
    parser.add_argument(
        "--forward", type=float, default=0.75, help="share of the policy's top speed"
    )
    parser.add_argument("--seconds", type=float, default=7.5, help="length of a walk")
    parser.add_argument("--out", type=Path, help="folder; by default named by the time")
    given = parser.parse_args(arguments)
    try:
        asked = Asked(given.walks, given.forward, given.seconds)
        lines = deploy(given.policy, given.robot, asked, given.out, Terminal())
    except KeyboardInterrupt:
        Terminal().say("gatjax-deploy: stopped; with its --out it goes on")
        return STOPPED
    except (ValueError, OSError, Stopped) as error:
        Terminal().say(f"gatjax-deploy: {error}")
        return FAILED
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
