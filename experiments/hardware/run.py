"""What the hardware side does when things go wrong, and how fast it answers.

    python experiments/hardware/run.py --out hardware [--minutes 2]

writes faults.md (every fault injected while a simulated NAO walks, and what came of it)
and latency.png with latency.json (from a frame to its answer, in real time).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from gatjax.hardware.deploy import Asked, deploy
from gatjax.hardware.lola import PERIOD
from gatjax.hardware.mind import Mind
from gatjax.hardware.poses import tilt_of
from gatjax.hardware.session import Stopped
from gatjax.hardware.terminal import Terminal
from gatjax.hardware.walks import walk
from gatjax.robot import nao
from gatjax.surrogate.attended import SimulatedNao
from gatjax.surrogate.faults import FAULTS, Direct, Fault, standing, started
from gatjax.surrogate.lola import Server
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0

KILLS = {"walk engine killed": signal.SIGKILL, "walk engine hangs": signal.SIGSTOP}
BEGIN = 150  # frames on its feet, when the fault begins
TASK = task_at(83.3, duration=3.0)


def main() -> None:
    """Inject faults, then walk in real time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robot", choices=["dart", "stiff"], default="dart")
    parser.add_argument("--minutes", type=float, default=2.0, help="of walking")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = [injected(given.robot, name, fault) for name, (fault, _) in FAULTS.items()]
    rows += [killed(given.robot, *each) for each in KILLS.items()]
    table = faults_table(rows)
    print(table)
    (given.out / "faults.md").write_text(table)
    late = latencies(given.robot, given.minutes, given.out / "walks")
    facts = facts_of(late)
    print(facts)
    (given.out / "latency.json").write_text(json.dumps(facts, indent=2) + "\n")
    draw(late, facts, given.out / "latency.png")


def facts_of(late: np.ndarray) -> dict:
    """Say how long answers took, ms; inf: there was none."""
    given = late[np.isfinite(late)]
    return {
        "frames": len(late),
        "median_ms": float(np.median(given)),
        "p99_ms": float(np.quantile(given, 0.99)),
        "p99_9_ms": float(np.quantile(given, 0.999)),
        "largest_ms": float(given.max()),
        "unanswered": len(late) - len(given),
    }


def killed(robot: str, name: str, number: int) -> tuple[str, str, str, str]:
    """Send the walk engine a signal while the robot walks."""
    mind = started(TASK, THETA0)

    def fault(link: Direct, since: int, message: bytes) -> bytes:
        if since == 0:
            os.kill(mind.process.pid, number)
        return message

    return injected(robot, name, fault, mind)


def injected(
    robot: str, name: str, fault: Fault, mind: Mind | None = None
) -> tuple[str, str, str, str]:
    """Let a robot walk into a fault: name, what the guard did, how it ended."""
    session, link = standing(robot, fault, BEGIN)
    mind = mind or started(TASK, THETA0)
    try:
        walk(session, mind, TASK)
        said = "walked on"
    except Stopped as stopped:
        said = str(stopped).partition("since ")[2]
    finally:
        mind.close()
    base = link.nao.base()
    height, tilt = base.position[2], np.rad2deg(np.abs(tilt_of(base.quaternion)).max())
    end = f"{'stands' if height > 0.2 else 'lies'}, tilt {tilt:.0f} deg"
    return name, said, end, commanded(link)


def commanded(link: Direct) -> str:
    """Say how close the commands came to what no joint may get."""
    targets = np.array([command.target for command in link.commands])
    assert np.isfinite(targets).all()
    assert ((targets >= nao.LOW) & (targets <= nao.HIGH)).all()
    speed = (np.abs(np.diff(targets, axis=0)) / PERIOD / nao.SPEEDS).max()
    return f"{100.0 * speed:.0f} %"


def faults_table(rows: list) -> str:
    """Write the table."""
    head = "| injected | the guard | the robot at the end | of top speed |\n"
    head += "|---|---|---|--:|\n"
    return head + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def serve(robot: str, path: Path) -> None:
    """Serve a simulated NAO in real time, in a process of its own."""
    server = Server(path, lockstep=False)

    def say(text: str) -> None:
        print(text, flush=True)
        if text.startswith("disconnected"):
            np.save(path.with_suffix(".npy"), np.array(server.answers))

    server.serve(SimulatedNao(robot, 0, 0), say)


def latencies(robot: str, minutes: float, out: Path) -> np.ndarray:
    """Walk in real time; return ms from a frame to its answer, [N], by the robot.

    inf: there was none before the next frame.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "nao.sock"
    told = path.with_name("nao.sock.json")
    told.unlink(missing_ok=True)  # of a run before
    server = multiprocessing.Process(target=serve, args=(robot, path), daemon=True)
    server.start()
    while not told.exists():
        time.sleep(0.1)
    asked = Asked(walks=max(1, round(minutes * 4.0)), seconds=15.0)
    deploy(Path("theta0"), f"lola:{path}", asked, out, Terminal())
    answers = path.with_suffix(".npy")
    while not (answers.exists() and np.load(answers).size > 1000):  # after the walks
        time.sleep(0.1)
    server.kill()
    return 1e3 * np.load(answers)


def draw(late: np.ndarray, facts: dict, path: Path) -> None:
    """Draw the histogram."""
    figure, axes = plt.subplots(figsize=(8.0, 3.6), layout="constrained")
    axes.hist(late[np.isfinite(late)], np.arange(0.0, 13.0, 0.1), color="#35618f")
    axes.set_yscale("log")
    axes.axvline(1e3 * PERIOD, color="#b3402a")
    axes.annotate("next frame", (1e3 * PERIOD, 1.0), color="#b3402a", ha="right",
                  xytext=(-4, 90), textcoords="offset points")  # fmt: skip
    axes.set_xlabel("from a frame to its answer, by the robot's clock [ms]")
    axes.set_ylabel("frames")
    axes.set_title(
        f"{facts['frames']} frames in real time: median {facts['median_ms']:.1f} ms, "
        f"99.9 % within {facts['p99_9_ms']:.1f} ms"
    )
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
