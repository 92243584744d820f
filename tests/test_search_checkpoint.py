"""Checkpoints: whole steps only, damage is found, resuming changes no number."""

import os
import signal
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint
import pytest

from gatjax import checkpoints
from gatjax.search import SearchSettings, Space, generation, start

SPACE = Space(np.zeros(5), np.full(5, 0.3), np.full(5, -2.0), np.full(5, 2.0))
SETTINGS = SearchSettings(population=12, rollouts=3)


def noisy(values, policies, keys):
    noise = jax.vmap(jax.random.normal)(keys)
    costs = ((policies - values) ** 2).sum(-1)
    return costs[:, None] + 0.01 * noise[None] * policies[:, :1]


def tree(number=0.0):
    return {
        "mean": jnp.arange(3.0) + number,
        "key": jax.random.key(4),
        "count": np.array(7),
        "C": (jnp.eye(3) * (number + 1.0), np.float32(0.5)),
    }


def same(one, two):
    flat_one, structure = jax.tree.flatten(one)
    flat_two, other = jax.tree.flatten(two)
    assert structure == other
    for a, b in zip(flat_one, flat_two, strict=True):
        if jnp.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def message_of(action, kind=ValueError):
    with pytest.raises(kind) as caught:
        action()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_tree_comes_back_bit_for_bit(tmp_path):
    for step in (0, 2, 10):
        checkpoints.save(tmp_path, step, tree(step))
    assert checkpoints.latest(tmp_path) == 10
    same(checkpoints.restore(tmp_path, tree()), tree(10))
    same(checkpoints.restore(tmp_path, tree(), step=2), tree(2))


def test_resuming_gives_the_numbers_of_an_uninterrupted_search(tmp_path):
    whole, rest = [], []
    step = jax.jit(generation(SPACE, SETTINGS, noisy))
    state = start(SPACE, SETTINGS, jax.random.key(11))
    for number in range(6):
        state, info = step(state, 0.7, number)
        whole.append(info)
        checkpoints.save(tmp_path, number, state)
    template = start(SPACE, SETTINGS, jax.random.key(0))
    fresh = jax.jit(generation(SPACE, SETTINGS, noisy))
    resumed = checkpoints.restore(tmp_path, template, step=2)
    for number in range(3, 6):
        resumed, info = fresh(resumed, 0.7, number)
        rest.append(info)
    same(rest, whole[3:])
    same(resumed, state)


def test_a_restored_state_does_not_trace_anew(tmp_path):
    traces = []

    def evaluate(values, policies, keys):
        traces.append(policies.shape)
        return noisy(values, policies, keys)

    step = jax.jit(generation(SPACE, SETTINGS, evaluate))
    state, _ = step(start(SPACE, SETTINGS, jax.random.key(1)), 0.7, 0)
    checkpoints.save(tmp_path, 0, state)
    step(checkpoints.restore(tmp_path, state), 0.7, 1)
    assert len(traces) == 1


def test_every_damaged_file_is_found_and_named(tmp_path):
    checkpoints.save(tmp_path, 0, tree(0))
    checkpoints.save(tmp_path, 1, tree(1))
    files = [file for file in (tmp_path / "1").rglob("*") if file.is_file()]
    assert len(files) > 3
    for file in files:
        whole = file.read_bytes()
        flipped = bytearray(whole)
        flipped[len(whole) // 2] ^= 0x55
        for damage in (whole[: len(whole) // 2], b"", bytes(flipped)):
            file.write_bytes(damage)
            text = message_of(lambda: checkpoints.restore(tmp_path, tree()))
            assert str(tmp_path / "1") in text
            assert file.name in text or file.name == checkpoints.FILES
            assert "delete that folder to resume from step 0" in text
        file.write_bytes(whole)
    same(checkpoints.restore(tmp_path, tree()), tree(1))


def test_the_only_step_damaged_says_start_again(tmp_path):
    checkpoints.save(tmp_path, 3, tree())
    (tmp_path / "3" / "manifest.ocdbt").unlink()
    text = message_of(lambda: checkpoints.restore(tmp_path, tree()))
    assert "delete that folder to start again" in text


def test_a_missing_step_lists_what_exists(tmp_path):
    missing = tmp_path / "nowhere"
    assert checkpoints.latest(missing) is None
    assert "no complete checkpoint" in message_of(
        lambda: checkpoints.restore(missing, tree()), FileNotFoundError
    )
    checkpoints.save(tmp_path, 4, tree())
    assert "[4]" in message_of(
        lambda: checkpoints.restore(tmp_path, tree(), step=5), FileNotFoundError
    )


def test_a_step_is_never_written_over(tmp_path):
    checkpoints.save(tmp_path, 1, tree(1))
    text = message_of(lambda: checkpoints.save(tmp_path, 1, tree(2)))
    assert "step 1 is in" in text
    same(checkpoints.restore(tmp_path, tree()), tree(1))


def test_a_state_of_other_settings_is_refused(tmp_path):
    checkpoints.save(tmp_path, 0, start(SPACE, SETTINGS, jax.random.key(0)))
    other = start(SPACE, SearchSettings(population=14), jax.random.key(0))
    text = message_of(lambda: checkpoints.restore(tmp_path, other))
    assert "parameters.weights is ((12,)" in text
    assert "(14,)" in text


@pytest.mark.parametrize("moment", ["during", "after"])
def test_ctrl_c_in_a_save_leaves_the_step_before(tmp_path, monkeypatch, moment):
    checkpoints.save(tmp_path, 0, tree(0))
    if moment == "during":  # orbax has written files but not renamed its folder

        def stop(*args, **kwargs):
            raise KeyboardInterrupt

        monkeypatch.setattr(
            orbax.checkpoint.StandardCheckpointHandler, "finalize", stop
        )
    else:  # orbax is done, the list of files is not

        def stop(place):
            raise KeyboardInterrupt

        monkeypatch.setattr(checkpoints, "_digests", stop)
    with pytest.raises(KeyboardInterrupt):
        checkpoints.save(tmp_path, 1, tree(1))
    monkeypatch.undo()
    assert len(list(tmp_path.iterdir())) == 2  # there is something left half-way
    assert checkpoints.latest(tmp_path) == 0
    same(checkpoints.restore(tmp_path, tree()), tree(0))
    checkpoints.save(tmp_path, 1, tree(1))
    same(checkpoints.restore(tmp_path, tree()), tree(1))


@pytest.mark.parametrize("place", ["_leaves", "_digests"])
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_waits_for_the_save(tmp_path, monkeypatch, stop, place):
    """Both of Ctrl-C and a cluster's SIGTERM, however they are heeded otherwise."""

    def heeded(number, frame):
        raise KeyboardInterrupt

    before, written = signal.signal(stop, heeded), getattr(checkpoints, place)

    def told(tree):
        signal.raise_signal(stop)
        return written(tree)

    monkeypatch.setattr(checkpoints, place, told)
    try:
        with pytest.raises(KeyboardInterrupt):
            checkpoints.save(tmp_path, 0, tree(0))
        assert signal.getsignal(stop) is heeded
    finally:
        signal.signal(stop, before)
    assert checkpoints.latest(tmp_path) == 0  # it was let finish


def test_a_step_is_on_disk_before_its_list_is(tmp_path, monkeypatch):
    synced, told = set(), os.fsync

    def sync(number):
        assert not (tmp_path / "0" / checkpoints.FILES).exists()
        synced.add(os.fstat(number).st_ino)
        told(number)

    monkeypatch.setattr(os, "fsync", sync)
    checkpoints.save(tmp_path, 0, tree(0))
    files = [file for file in (tmp_path / "0").rglob("*") if file.is_file()]
    assert {file.stat().st_ino for file in files} <= synced


SAVE_UNTIL_KILLED = """
import sys, numpy
from gatjax import checkpoints
for step in range(100):
    tree = {"x": numpy.random.default_rng(step).normal(size=1_000_000)}
    checkpoints.save(sys.argv[1], step, tree)
"""


def test_a_kill_in_a_save_leaves_a_usable_step(tmp_path):
    command = [sys.executable, "-c", SAVE_UNTIL_KILLED, str(tmp_path)]
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            names = [path.name for path in tmp_path.iterdir()]
            if "1" in names and any("tmp" in name for name in names):
                process.send_signal(signal.SIGKILL)
                break
            time.sleep(0.001)
    assert process.returncode == -signal.SIGKILL
    step = checkpoints.latest(tmp_path)
    assert step is not None
    found = checkpoints.restore(tmp_path, {"x": np.zeros(1_000_000)})
    expected = np.random.default_rng(step).normal(size=1_000_000)
    np.testing.assert_array_equal(found["x"], expected)
    checkpoints.save(tmp_path, step + 1, {"x": expected})


SAVE_WITHOUT_ROOM = """
import resource, sys, numpy
from gatjax import checkpoints
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # bytes in a file
try:
    noise = numpy.random.default_rng(0).normal(size=9999)
    checkpoints.save(sys.argv[1], 1, {"x": noise})
except ValueError as error:
    print(error)
"""


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path):
    checkpoints.save(tmp_path, 0, tree(0))
    command = [sys.executable, "-c", SAVE_WITHOUT_ROOM, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "File too large" in run.stdout
    assert "complete steps are [0]" in run.stdout
    assert run.stdout.count("\n") == 1
    assert run.stderr == ""
    same(checkpoints.restore(tmp_path, tree()), tree(0))
    checkpoints.save(tmp_path, 1, tree(1))


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    text = message_of(lambda: checkpoints.save(tmp_path / "file" / "c", 0, tree()))
    assert "could not be written" in text
