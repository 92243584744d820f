"""Does the walk engine say here what it said in gatjax, and how long does it think?

    python robot/check.py ticks.npz [--ticks 300000]

runs on any Python that has gatjax-robot. ticks.npz holds recorded readings and what the
jitted policy answered (`tests/test_hardware_shim.py` writes one).
"""

from __future__ import annotations

import argparse
import json
import platform
import time

import numpy as np

from gatjax import task as tasks
from gatjax.records import Reading

WARM = 1000  # ticks before memory is looked at


def main() -> None:
    """Print what came out as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file")
    parser.add_argument("--ticks", type=int, help="go round until so many are done")
    given = parser.parse_args()
    with np.load(given.file) as file:
        kept = {name: file[name] for name in file.files}
    count = given.ticks or kept["target"].shape[0] * kept["target"].shape[1]
    seconds, worst, memory = ticked(kept, count)
    print(json.dumps({
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "ticks": count,
        "largest_difference_rad": worst,
        "median_ms": 1e3 * float(np.median(seconds)),
        "p99_9_ms": 1e3 * float(np.quantile(seconds, 0.999)),
        "memory_growth_kB": memory,
    }))  # fmt: skip


def ticked(kept, count):
    """Answer readings; return s of each tick, rad of the worst, growth of memory."""
    task, policy, go = tasks.task_at(83.3), kept["policy"], np.asarray(int(kept["go"]))
    seconds = np.full(count, np.nan)  # its pages are there before memory is looked at
    worst, done, before = 0.0, 0, 0
    while True:
        for run in range(kept["target"].shape[0]):
            state = tasks.begin(policy)
            for tick in range(kept["target"].shape[1]):
                reading = Reading(*(kept[name][run, tick] for name in Reading._fields))
                began = time.perf_counter()
                state, target = tasks.pilot(task, policy, go, state, reading)
                seconds[done] = time.perf_counter() - began
                worst = max(worst, np.abs(target - kept["target"][run, tick]).max())
                done += 1
                if done == min(WARM, count):
                    before = resident()
                if done == count:
                    return seconds, float(worst), resident() - before


def resident() -> int:
    """Memory of this process, kB."""
    with open("/proc/self/status") as file:
        lines = [line for line in file if line.startswith("VmRSS")]
    return int(lines[0].split()[1])


if __name__ == "__main__":
    main()
