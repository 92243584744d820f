"""python -m gatjax.surrogate.hidden --out DIR --cases N --seed S."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from gatjax.surrogate.hidden import MIX, ROBOTS, write_cases


def main() -> int:
    """Writes cases as the command line says."""
    parser = argparse.ArgumentParser(prog="gatjax.surrogate.hidden")
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--cases", type=int, default=40, help="how many")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", choices=list(MIX), default=list(MIX))
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=None)
    parser.add_argument("--causes", nargs="+", default=None)
    wanted = parser.parse_args()
    began = time.monotonic()

    def progress(done: int, count: int) -> None:
        spent = time.monotonic() - began
        print(f"{done}/{count} cases, {spent:.0f} s", flush=True)

    mix = {kind: MIX[kind] for kind in wanted.kinds}
    try:
        write_cases(
            wanted.out,
            wanted.cases,
            wanted.seed,
            mix,
            wanted.robots,
            wanted.causes,
            progress,
        )
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
