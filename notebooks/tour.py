# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A tour of gatjax
#
# A robot behaves differently from its simulator. This notebook takes the files of a
# run, lets the simulator learn from them, and searches for a walk in what it learned.
#
# To open it: `jupytext --to ipynb notebooks/tour.py`. It reads the latest run
# in `runs/` that ended (`make run` makes one); where there is none, it makes a tiny
# one.

# %%
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from gatjax import loop, runs, search
from gatjax.cli.progress import shown
from gatjax.data.recording import check_recording, read_recording
from gatjax.data.trajectories import to_arrays
from gatjax.grounding.learn import grounded
from gatjax.records import JOINTS
from gatjax.report import build_report
from gatjax.robot.nao import WALKING_JOINTS
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.backend import costs, prepare, use_compile_cache
from gatjax.sim.world import add_cause, nominal
from gatjax.surrogate import make_robot
from gatjax.task import task_at
from gatjax.walk.parameters import HIGH, LOW, PARAMETERS, STEP, THETA0

use_compile_cache()

# %% [markdown]
# ## A run folder
#
# The tiny run below has far too few rollouts to find a better walk; it has every file.


# %%
def tiny_run(root: Path) -> Path:
    """Run the whole loop with hardly any rollouts."""
    settings = loop.resolved(
        LoopSettings(
            robot="stiff",
            methods=("gat",),
            robot_trajectories=5,
            simulator_trajectories=5,
            evaluations=1,
            search=SearchSettings(population=6, rollouts=2, generations=2),
            backend="native",
        )
    )
    folder = runs.open_run(root, settings).path
    with shown(loop.total_work(settings)) as progress:
        loop.run(folder, settings, make_robot(settings.robot), progress)
    build_report(folder)
    return folder


reports = [*Path("runs").glob("*/report.html"), *Path("../runs").glob("*/report.html")]
done = sorted((path.parent for path in reports), key=lambda path: path.name)
folder = done[-1] if done else tiny_run(Path("runs"))
config = runs.resume_run(folder).config
print(f"{folder}: robot {config['robot']}, methods {config['methods']}")

# %% [markdown]
# ## The ideal simulator
#
# `nominal` is the NAO in MuJoCo without any realism term. `theta0` is the hand-tuned
# walk: 15 numbers. Twenty rollouts differ by their starts and by the sensors' noise.

# %%
task = task_at(config["rate_hz"])
world = nominal(task)
keys = jax.random.split(jax.random.key(0), 20)
walks, outcome = prepare(world).rollout(world.values, np.tile(THETA0, (20, 1)), keys)
print(
    f"theta0 in the simulator: {100 * outcome.velocity.mean():.1f} cm/s, "
    f"{np.isfinite(outcome.fell_at).sum()} of 20 fell"
)

# %% [markdown]
# ## What the robot did
#
# Recordings are Parquet files of what was commanded and what was measured. Here is one
# knee on the robot and in the simulator, each with the target that it was given.

# %%
logs = [
    read_recording(folder / "recordings" / f"{name}_0.parquet")
    for name in ("robot", "simulator")
]
for log in logs:
    check_recording(log, JOINTS)
knee = WALKING_JOINTS.index("LKneePitch")
figure, panels = plt.subplots(1, 2, figsize=(10, 3), sharey=True)
for panel, log in zip(panels, logs, strict=True):
    walk = to_arrays(log, WALKING_JOINTS)[0]
    panel.plot(walk.time, np.rad2deg(walk.command[:, knee]), label="target")
    panel.plot(walk.time, np.rad2deg(walk.angle[:, knee]), label="measured")
    panel.set(xlim=(2.0, 4.0), xlabel="s", ylabel="left knee, deg")
    panel.set_title(log.metadata["robot"])
    panel.legend()
figure.tight_layout()

# %% [markdown]
# ## Grounding
#
# GAT learns two models: what the robot does with an action, and which action makes the
# simulator do the same. Together they are a command effect: it sits between the walk
# and the simulator. Its share `alpha` is the largest with which theta0 does not fall.

# %%
grounding = loop.learn_grounding(world, "gat", *logs, seed=config["seed"])
grounding = loop.stable(world, grounding, THETA0, jax.random.key(1))
print(f"alpha {grounding.facts['alpha']}")

# %% [markdown]
# Does it predict the robot better? Replayed open loop, from states and commands of
# trajectories that were held out:

# %%
errors = loop.predictions(world, grounding, logs[0], config["seed"])
long = [row for row in errors if row["horizon_s"] > 0.1]
place = np.arange(len(long))
figure, panel = plt.subplots(figsize=(10, 3))
for shift, when in ((-0.2, "before_rad"), (0.2, "after_rad")):
    degrees = np.rad2deg([row[when] for row in long])
    panel.bar(place + shift, degrees, width=0.4, label=when.partition("_")[0])
panel.set_xticks(place, [row["joint"] for row in long], rotation=45, ha="right")
panel.set_ylabel("error after 0.5 s, deg")
panel.legend()
before, after = (sum(row[when] for row in long) for when in ("before_rad", "after_rad"))
print(f"error after 0.5 s, all joints: {100 * (after / before - 1):+.0f} %")

# %% [markdown]
# ## A known cause instead of a learned one
#
# Effects can be added by name as well; `gatjax.effects.catalogue` has the list.

# %%
slow = add_cause(world, "command_delay", ["all"], 0.036)
_, outcome = prepare(slow).rollout(slow.values, np.tile(THETA0, (20, 1)), keys)
print(
    f"theta0 with 36 ms of delay: {100 * outcome.velocity.mean():.1f} cm/s, "
    f"{np.isfinite(outcome.fell_at).sum()} of 20 fell"
)

# %% [markdown]
# ## Search
#
# One tiny generation of CMA-ES in the grounded simulator. A real one has 150 policies
# with 20 rollouts each. Cost goes down: minus the velocity in m/s, plus 15 for a fall.

# %%
better = grounded(world, grounding)
settings = SearchSettings(population=8, rollouts=2)
space = search.Space(theta0=THETA0, step=STEP, low=LOW, high=HIGH)
state = search.start(space, settings, jax.random.key(2))
generation = search.host_generation(space, settings, costs(prepare(better)))
state, info = generation(state, better.values, 0)
print(f"costs {np.round(np.sort(info.costs), 3)}")

# %% [markdown]
# ## Policies and metrics
#
# What the run kept: a policy file for each candidate, and its row in `metrics.csv`.

# %%
rows = runs.read_table(folder / "metrics.csv")
print(f"{'policy':<16}{'simulator':>11}{'robot':>8} cm/s{'falls':>7}")
for row in rows:
    name = "{method}_{iteration}_{generation}_{candidate}".format(**row)
    name = "theta0" if row["method"] == "theta0" else name
    simulated = row["simulator_velocity_m_s"]
    said = "" if simulated is None else f"{100 * simulated:.1f}"
    if row["robot_velocity_m_s"] is not None:
        walks = f"{row['robot_falls']} of {row['robot_rollouts']}"
        print(f"{name:<16}{said:>11}{100 * row['robot_velocity_m_s']:>8.1f}{walks:>15}")

# %%
kept = [
    "{method}_{iteration}_{generation}_{candidate}".format(**row)
    for row in rows if row["candidate"] in ("best", "mean")
]  # fmt: skip
print(kept[-1])
theta = runs.read_policy(folder / "policies" / f"{kept[-1]}.json")
for parameter, value in zip(PARAMETERS, theta, strict=True):
    change = (value - parameter.theta0) / parameter.step
    print(
        f"{parameter.name:<26}{parameter.theta0:>8.3f} -> {value:>8.3f} "
        f"{parameter.unit:<6}({change:+.1f} steps)"
    )
assert np.all((theta >= LOW) & (theta <= HIGH))
print(f"the report: {(folder / 'report.html').resolve()}")
