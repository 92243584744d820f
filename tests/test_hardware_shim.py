"""What runs on the robot: a small wheel that says what the jitted policy says."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gatjax import task as tasks
from gatjax.records import Reading
from gatjax.surrogate import make_robot
from gatjax.walk.parameters import THETA0

ROOT = Path(__file__).parents[1]
RUNS = 15  # of 685 ticks: 10,275
GO = 50


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder]
    subprocess.run(command, cwd=ROOT / "robot", check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A folder with the wheel's files, and nothing else of gatjax."""
    folder = tmp_path_factory.mktemp("robot")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def ticks(tmp_path_factory):
    """Recorded readings, and what the jitted policy answers in double precision."""
    task = tasks.task_at(83.3)
    walks, _ = make_robot("stiff").walk(np.tile(THETA0, (RUNS, 1)), range(RUNS), task)

    def run(policy, readings):
        def step(state, reading):
            return tasks.pilot(task, policy, jnp.asarray(GO), state, reading)

        return jax.lax.scan(step, tasks.begin(policy), readings)[1]

    with jax.enable_x64(True):
        readings = jax.tree.map(jnp.asarray, walks.reading)
        target = jax.jit(jax.vmap(run, (None, 0)))(jnp.asarray(THETA0), readings)
        target = np.asarray(target)
    path = tmp_path_factory.mktemp("ticks") / "ticks.npz"
    np.savez(path, target=target, policy=THETA0, go=GO, **walks.reading._asdict())
    return path


def test_the_wheel_is_small_and_holds_what_it_needs(wheel):
    assert wheel.stat().st_size < 300_000
    names = zipfile.ZipFile(wheel).namelist()
    rooms = {name.split("/")[1] for name in names if name.startswith("gatjax/")}
    assert {"hardware", "walk", "task.py"} <= rooms
    assert not {"sim", "loop", "data", "surrogate"} & rooms
    assert not [name for name in names if "__pycache__" in name]


def test_it_imports_numpy_and_nothing_else(installed):
    code = (
        "import sys, gatjax.hardware.__main__ as m, gatjax; print(gatjax.__file__);"
        "print({n.partition('.')[0] for n in sys.modules} & "
        "{'jax', 'jaxlib', 'mujoco', 'scipy', 'pyarrow', 'yaml', 'rich', 'tyro'})"
    )
    told = run_there(sys.executable, installed, ["-c", code]).splitlines()
    assert told == [str(installed / "gatjax" / "__init__.py"), "set()"]


def pythons():
    """This Python, and those that GATJAX_PYTHONS names, with colons between."""
    others = os.environ.get("GATJAX_PYTHONS", "")
    return [sys.executable, *filter(None, others.split(":"))]


@pytest.mark.parametrize("python", pythons())
def test_targets_are_those_of_the_jitted_policy(python, installed, ticks):
    script = shutil.copy(ROOT / "robot" / "check.py", installed)
    told = json.loads(run_there(python, installed, [script, str(ticks)]))
    assert told["ticks"] >= 10_000
    assert told["largest_difference_rad"] < 1e-6


def test_single_precision_only_rounds(ticks):
    """A search runs in single precision: the same walk to a few 1e-5 rad."""
    task = tasks.task_at(83.3)
    with np.load(ticks) as file:
        readings = Reading(*(file[name][0] for name in Reading._fields))
        target = file["target"][0]
    state, policy = tasks.begin(THETA0.astype("f4")), THETA0.astype("f4")
    for tick in range(len(target)):
        reading = Reading(*(part[tick].astype("f4") for part in readings))
        state, answer = tasks.pilot(task, policy, np.asarray(GO), state, reading)
        np.testing.assert_allclose(answer, target[tick], atol=2e-4)


@pytest.mark.parametrize("python", pythons())
def test_help_starts_everywhere(python, installed):
    told = run_there(python, installed, ["-m", "gatjax.hardware", "--help"])
    assert "gatjax-deploy" in told


def test_errors_are_lines(installed, tmp_path):
    command = [sys.executable, "-m", "gatjax.hardware", "theta0"]
    socket = tmp_path / "none"
    done = subprocess.run(
        [*command, "--robot", f"lola:{socket}"],
        cwd=installed, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "no LoLA there" in done.stderr


def run_there(python, folder, arguments):
    """Run a Python in a folder, with its packages there and its own."""
    done = subprocess.run(
        [python, *arguments], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(folder)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout
