"""Does a neural policy on top of the walk engine walk faster than the engine alone?

    python experiments/residual/run.py --out DIR

PPO trains a policy that adds up to a few degrees to the engine's joint targets; it sees
joint angles, targets and the gyro. Same environment, same PPO as the groundings rgat
and garat. The plain walk and the trained one then do 100 fresh walks each. Needs Brax
(pip install 'gatjax[rl]'). It writes DIR/results.json and DIR/residual.png.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from gatjax.benchmark.expected import compare
from gatjax.records import Reading, Signal
from gatjax.rl import ppo
from gatjax.rl.env import View, Walk
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.runs import write_json
from gatjax.sim.lighter import lighter
from gatjax.sim.world import World, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

SEED, FRESH, ROUNDS = 20280, 100, 80
SCALE = 0.05  # rad that an action of 1 adds
JOINTS = len(WALKING_JOINTS)
LIKE = np.repeat([0.5, 0.1, 0.05, 0.5], [JOINTS, JOINTS, JOINTS, 3])
"""How large observations are: angles, target - angle, change of target rad, gyro."""


def seen(memory: Any, signal: Signal, reading: Reading) -> Any:
    """Where the joints are, where they are told to go and how fast, and the gyro."""
    parts = signal.angle, signal.target - signal.angle, signal.target - memory
    return jnp.concatenate([*parts, reading.gyro])


VIEW = View(
    size=len(LIKE),
    begin=lambda signal: signal.target,
    look=seen,
    push=lambda memory, signal, sent: signal.target,
)


def walked(world: World, policy: ppo.Learned | None, seed: int) -> dict[str, Any]:
    """Walk with a policy's mean action, or without any."""
    env, ticks = Walk(world, THETA0, VIEW, SCALE), world.task.ticks - 1

    def episode(words: Any) -> tuple:
        def step(carry: tuple, _: None) -> tuple:
            state, total, fell = carry
            action = jnp.zeros(JOINTS)
            if policy is not None:
                action = ppo.act(policy, jnp.clip(state.obs / LIKE, -8.0, 8.0))
            state = env.step(state, action)
            total = total + jnp.where(fell > 0, 0.0, state.metrics["forward_m"])
            return (state, total, jnp.maximum(fell, state.done)), None

        begin = env.reset(words), jnp.zeros(()), jnp.zeros(())
        (_, total, fell), _ = jax.lax.scan(step, begin, None, length=ticks)
        return total / world.task.duration, fell

    keys = jax.random.split(jax.random.key(seed), FRESH)
    speed, fell = jax.jit(jax.vmap(episode))(jax.random.key_data(keys))
    error = float(100.0 * np.std(speed) / np.sqrt(FRESH))
    return {"cm_s": float(100.0 * np.mean(speed)), "error_cm_s": error,
            "falls": float(np.mean(fell))}  # fmt: skip


def main() -> None:
    """Train, walk, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    told = parser.parse_args()
    told.out.mkdir(parents=True, exist_ok=True)
    world, begun, curve, best = lighter(nominal(Task())), time.perf_counter(), [], None
    plan = ppo.Plan(rounds=told.rounds, unroll=20, discount=0.97, deviation=0.2)
    scale = ppo.Scale(np.zeros(len(LIKE)), LIKE)
    for found in ppo.trained(Walk(world, THETA0, VIEW, SCALE), scale, plan, SEED):
        if not curve or found.reward > max(curve):
            best = found.policy
        curve.append(found.reward)
        if len(curve) % 10 == 1:
            spent = time.perf_counter() - begun
            left = spent / len(curve) * (told.rounds - len(curve))
            print(
                f"round {len(curve)} of {told.rounds}: reward {1e3 * curve[-1]:.3f} "
                f"mm/s a tick, about {left / 60.0:.1f} min left",
                flush=True,
            )
    results = {
        "plain": walked(world, None, SEED + 1),
        "residual": walked(world, best, SEED + 1),
        "curve": curve,
        "seconds": time.perf_counter() - begun,
    }
    results["gain"] = results["residual"]["cm_s"] / results["plain"]["cm_s"] - 1.0
    write_json(told.out / "results.json", results)
    figure = Figure((5.4, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.multiply(curve, 1e3), color="#0072B2")
    axes.set(xlabel="round of 64 walks", ylabel="mean reward of a tick, mm/s")
    figure.savefig(told.out / "residual.png", dpi=110)
    against = compare(results, Path(__file__).parent / "expected.json")
    print(f"\n{against.table}\n\n{told.out / 'results.json'}")
    if against.off:
        raise SystemExit(f"not as in expected.json: {', '.join(against.off)}")


if __name__ == "__main__":
    main()
