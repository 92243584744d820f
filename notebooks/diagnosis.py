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
# # What does this simulation get wrong?
#
# A servo with an arm moves differently from its simulation. This notebook takes its
# logs, shows the difference, asks `gatjax.diagnosis` for the cause, and measures what
# knowing it is worth. To open it: `jupytext --to ipynb notebooks/diagnosis.py`.
#
# The robot is one of the hidden cases that score the diagnosis: another engine, another
# step, another friction law, masses and gains of its own. The diagnosis gets a nominal
# model and logs only; we look at the answer at the end.

# %%
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as parquet

from gatjax.data.recording import read_recording
from gatjax.diagnosis.case import held, prepare
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.given import Logs, control_period, cut
from gatjax.diagnosis.hypotheses import TOLERANCES
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.start import Start
from gatjax.report.diagnosis import write_report
from gatjax.robot import model as robots
from gatjax.sim.backend import use_compile_cache
from gatjax.sim.stored import read_world
from gatjax.surrogate.hidden import write_cases
from gatjax.task import Task

use_compile_cache()

# %% [markdown]
# ## Logs and a nominal model

# %%
folder = Path("hidden")
write_cases(
    folder, 1, 7, robots=("arm_servo",), mix={"single": 1.0}, causes=("backlash",)
)
case = next((folder / "cases").iterdir())
source = str(folder / "models" / "arm_servo.xml")
fit = [read_recording(path) for path in sorted(case.glob("fit*.parquet"))]
unseen = [read_recording(case / "held.parquet")]
model = robots.load(source)
names = robots.joint_names(model)
logs = cut(fit, names)
print(f"{len(logs)} runs of {names}, a row every {1e3 * control_period(logs):.0f} ms")

# %% [markdown]
# ## Is it more than tolerances?
#
# Nominal numbers are never exact: gains, friction, masses and encoder zeros may be off
# by some percent. Those are fitted first, each held back by its tolerance. What they
# can't take away is worth a closer look.

# %%
quiet = lambda stage, share: None  # noqa: E731
prepared = prepare(held(model, logs, 0), logs, quiet)
joint, healthy = prepared.joints[0], prepared.healthy[0]
print(f"left by the best tolerances: {healthy.rms() / joint.noise:.1f} times the noise")
used = dict(zip(TOLERANCES, healthy.x, strict=True))
print("used up most:", sorted(used, key=lambda name: -abs(used[name]))[:4])

# %%
start = np.cumsum([0, *joint.valid.sum(1)])
figure, axes = plt.subplots(len(logs), 1, figsize=(9, 2.5 * len(logs)), squeeze=False)
for number, axis in enumerate(axes[:, 0]):
    rest = healthy.residual[start[number] : start[number + 1]]
    axis.plot(logs[number].time - logs[number].time[0], 1e3 * rest, lw=0.8)
    axis.set(ylabel="measured - simulated, mrad", xlabel="s")
plt.show()

# %% [markdown]
# ## Which law explains it?
#
# Every cause of the catalogue is added in turn and fitted beside the tolerances. The
# gain is in nats of evidence, prices for free numbers paid; the first cause of all
# needs 3.5, a further one more.

# %%
claims = Judge(prepared, quiet).claims()
for claim in claims[:5]:
    left = claim.fits[0].rms() / joint.noise
    print(f"{claim.hypothesis.name:40} {claim.gain:7.1f} nats, leaves {left:4.1f}")

# %% [markdown]
# ## The whole diagnosis
#
# `diagnose` does all of this, checks for second causes and for laws that no entry
# describes, extends the model, and measures on a motion that it was not fitted to.

# %%
out = Path("found")
found = diagnose(Start(source), Logs(fit, unseen), out, 0, quiet)
print(found["verdict"], "-", found["sentence"])
for row in found["causes"]:
    for name, value in row["parameters"].items():
        print(f"  {name}: {value['value']:.4g} {value['unit']}", end="")
        print(f"  [{value['low']:.4g}, {value['high']:.4g}]" if "low" in value else "")
gain = found["gain"]
print(f"held-out error {gain['before']:.5f} -> {gain['after']:.5f} rad,", end=" ")
print(f"a learned model reaches {gain['learned_ceiling']:.5f}")

# %%
signals = parquet.read_table(out / "signals.parquet").to_pydict()
rows = np.flatnonzero(np.array(signals["part"]) == 1)
time = np.array(signals["time"])[rows]
figure, axis = plt.subplots(figsize=(9, 3))
for key, style in (("nominal", "C1"), ("extended", "C2")):
    error = np.array(signals[f"{key}.{names[0]}"]) - signals[f"measured.{names[0]}"]
    axis.plot(time, 1e3 * error[rows], style, lw=0.8, label=key)
axis.set(xlabel="s", ylabel="error on the held-out log, mrad")
axis.legend()
plt.show()

# %% [markdown]
# ## What now?
#
# `world.json` is a simulation, for `--world`, `extended.xml` what plain MJCF can say of
# it, and `report.html` the same story with more pictures. If a doubt is left, the next
# experiment says which motion would settle it.

# %%
world, _ = read_world(out / "world.json", Task(control_period=control_period(logs)))
print("causes in the world:", [row["cause"] for row in world.causes])
print("next:", (found["next_experiment"] or {}).get("why"))
print(write_report(out))

# %% [markdown]
# ## The answer

# %%
answer = json.loads((folder / "answers.json").read_text())["cases"][0]["causes"]
for row in answer:
    print(row["cause"], row["where"], row["parameters"])
