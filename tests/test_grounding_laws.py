"""Groundings: identity where nothing differs, a closed gap where something does."""

import jax
import numpy as np
import pytest

from gatjax.data.trajectories import JointRun, to_arrays, to_recording
from gatjax.effects.effect import chain
from gatjax.grounding import dagger, prediction
from gatjax.grounding import learn as grounders
from gatjax.grounding.envelope import Envelope
from gatjax.grounding.gat import next_angle_of
from gatjax.grounding.network import predict, train
from gatjax.grounding.transitions import HISTORY, transitions
from gatjax.loop import learn_grounding
from gatjax.records import JOINTS, Signal
from gatjax.robot.nao import WALKING, WALKING_JOINTS
from gatjax.sim.backend import prepare
from gatjax.sim.world import add_cause, nominal
from gatjax.task import Task
from gatjax.walk.parameters import THETA0

TASK = Task(duration=3.0)
RUNS = 16


def recording_of(world, first):
    keys = jax.random.split(jax.random.key(first), RUNS)
    policies = np.tile(THETA0, (RUNS, 1))
    walk, outcome = prepare(world, "native").rollout(world.values, policies, keys)
    assert not np.isfinite(outcome.fell_at).any()
    return to_recording(walk, "test", 50.0, {})


@pytest.fixture(scope="module")
def world():
    return nominal(TASK)


@pytest.fixture(scope="module")
def late_world(world):
    """A robot whose motors answer 36 ms late and are weaker."""
    late = add_cause(world, "command_delay", ["all"], 0.036)
    return add_cause(late, "torque_limit", ["all"], 3.0)


@pytest.fixture(scope="module")
def logs(world, late_world):
    return {
        "simulator": recording_of(world, 1),
        "twin": recording_of(world, 2),
        "late": recording_of(late_world, 3),
    }


def velocity(world, grounding, walks=8):
    """Mean speed of walks that stand, and how many fall."""
    grounded = grounders.grounded(world, grounding)
    keys = jax.random.split(jax.random.key(9), walks)
    policies = np.tile(THETA0, (walks, 1))
    result = prepare(grounded, "native").outcome(grounded.values, policies, keys)
    fell = np.isfinite(result.fell_at)
    return float(result.velocity[~fell].mean()), int(fell.sum())


@pytest.fixture(scope="module")
def plain(world):
    """Speed of the world by itself, m/s."""
    return velocity(world, grounders.Grounding("none", (), {}))[0]


@pytest.mark.parametrize("method", ["none", "envelope", "gat", "sgat", "sensing"])
def test_identical_robot_teaches_the_identity(method, world, logs, plain, tmp_path):
    grounding = learn_grounding(world, method, logs["twin"], logs["simulator"], 0)
    survives(grounding, tmp_path)
    # sgat samples what its model is unsure of: 8 % of 800 walks fell of it
    walks, most = (40, 8) if method == "sgat" else (8, 0)
    speed, falls = velocity(world, grounding, walks)
    assert falls <= most
    assert speed == pytest.approx(plain, abs=0.01)
    effect = grounders.METHODS[method].effect(WALKING)
    run = to_arrays(logs["twin"], JOINTS)[0]
    changes = []
    still = np.zeros(len(JOINTS), np.float32)
    noise = np.random.default_rng(0).normal(size=(100, len(JOINTS)))
    state = None
    ticks = zip(run.command[:100], run.angle[:100], noise, strict=True)
    for command, angle, drawn in ticks:
        told = (np.float32(part) for part in (command, angle))
        signal = Signal(*told, still, np.float32(drawn))
        signal = jax.tree.map(jax.numpy.asarray, signal)
        state = effect.init(grounding.params, signal) if state is None else state
        state, sent = effect.apply(grounding.params, state, signal)
        changes.append(np.asarray(sent.target) - command)
    rms = np.sqrt(np.mean(np.square(changes)))
    assert rms < np.deg2rad(0.25)


def test_guided_is_no_identity_because_its_assumption_fails_here(
    world, logs, plain, tmp_path
):
    """Farchy et al. assume that a command is reached in one tick; ours takes longer."""
    grounding = learn_grounding(world, "guided", logs["twin"], logs["simulator"], 0)
    survives(grounding, tmp_path)
    speed, falls = velocity(world, grounding)
    assert falls > 0 or abs(speed - plain) > 0.02


def test_gat_closes_most_of_the_prediction_gap(world, logs):
    grounding = learn_grounding(world, "gat", logs["late"], logs["simulator"], 0)
    held_out = np.unique(logs["late"].trajectory)
    windows = prediction.cut(world, logs["late"], held_out, 100, 5)
    found = []
    for candidate in (world, grounders.grounded(world, grounding)):
        backend = prepare(candidate, "native")
        error = prediction.errors(backend, candidate.values, windows, 0.02)
        for horizon in (0.02, 0.5):
            parts = [v**2 for (_, seconds), v in error.items() if seconds == horizon]
            found.append(np.sqrt(np.mean(parts)))
    before, before_long, after, after_long = found
    assert after < 0.5 * before
    assert after_long < 0.5 * before_long


def test_the_replay_of_the_simulator_itself_is_nearly_exact(world, logs):
    windows = prediction.cut(world, logs["twin"], np.arange(RUNS), 60, 0)
    backend = prepare(world, "native")
    error = prediction.errors(backend, world.values, windows, 0.02)
    assert max(error.values()) < np.deg2rad(0.6)


@pytest.mark.parametrize(
    ("name", "value", "larger"),
    [("encoder_offset", 0.05, 1.0), ("encoder_scale", 0.9, 0.9)],
)
def test_windows_start_where_encoders_say_what_was_recorded(name, value, larger, world):
    """The robot walks the same; its log is predicted as well as that of the other."""
    found = []
    for each in (world, add_cause(world, name, ["LKneePitch"], value)):
        windows = prediction.cut(each, recording_of(each, 4), np.arange(RUNS), 60, 0)
        error = prediction.errors(prepare(each, "native"), each.values, windows, 0.02)
        found.append(error["LKneePitch", 0.02])
    assert found[1] == pytest.approx(larger * found[0], abs=1e-5)


def test_a_log_without_the_torso_pose_will_do(world, logs):
    """A real NAO does not know where its torso is; its posture tells enough."""
    log = logs["twin"]
    columns = {k: v for k, v in log.columns.items() if not k.startswith("base.")}
    angle = np.stack([log.columns[f"position.{joint}"] for joint in JOINTS], -1)
    guessed = prediction.base_poses(world, log._replace(columns=columns), angle)
    known = prediction.base_poses(world, log, angle)
    assert np.abs(guessed[:, 2] - known[:, 2]).max() < 0.01
    found = []
    for recording in (log, log._replace(columns=columns)):
        windows = prediction.cut(world, recording, np.arange(RUNS), 60, 0)
        backend = prepare(world, "native")
        error = prediction.errors(backend, world.values, windows, 0.02)
        found.append(max(v for (_, horizon), v in error.items() if horizon == 0.02))
    assert found[1] < np.deg2rad(1.0)


def survives(grounding, folder):
    """Whatever was learned is read as it was written."""
    grounding = grounders.with_alpha(grounding, 0.7)
    grounders.write_grounding(folder, grounding)
    again = grounders.read_grounding(folder)
    assert again.method == grounding.method
    jax.tree.map(np.testing.assert_array_equal, again.params, grounding.params)
    chain(grounding=grounders.METHODS[grounding.method].effect(WALKING))


def test_dagger_plays_in_its_world_and_survives_its_folder(
    world, logs, tmp_path, monkeypatch
):
    monkeypatch.setattr(dagger, "ROUNDS", 1)
    grounding = learn_grounding(world, "dagger", logs["late"], logs["simulator"], 0)
    assert len(grounding.facts["rounds"]) == 2
    survives(grounding, tmp_path)


def test_a_broken_grounding_folder_is_one_line(tmp_path, world, logs):
    with pytest.raises(ValueError, match="no complete grounding"):
        grounders.read_grounding(tmp_path)
    grounding = learn_grounding(world, "envelope", logs["late"], logs["simulator"], 0)
    grounders.write_grounding(tmp_path, grounding)
    (tmp_path / "weights.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match="no complete grounding"):
        grounders.read_grounding(tmp_path)


def test_alpha_is_the_largest_that_does_not_fall():
    params = grounders.Grounding("envelope", _envelope(), {})
    tried = []

    def falls(candidate):
        tried.append(candidate.facts["alpha"])
        return 0.5 * (candidate.params.alpha > 0.72)

    chosen = grounders.largest_stable_alpha(params, falls)
    assert chosen.facts == {"alpha": 0.7, "falls": 0.0}
    assert tried == sorted(tried, reverse=True)
    with pytest.raises(ValueError, match="even without grounding"):
        grounders.largest_stable_alpha(params, lambda candidate: 1.0)


def test_alpha_of_a_walk_that_always_falls_sometimes_is_where_it_falls_least():
    params = grounders.Grounding("envelope", _envelope(), {})

    def falls(candidate):
        return (
            0.5 if candidate.params.alpha < 0.55 else 0.3 + candidate.params.alpha / 2
        )

    chosen = grounders.largest_stable_alpha(params, falls)
    assert chosen.facts == {"alpha": 0.5, "falls": 0.5}


def _envelope():
    return Envelope(np.float32(1.0), np.zeros(len(JOINTS), np.float32))


def test_transitions_line_up_in_time():
    time = np.arange(20.0)
    angle = time[:, None] + np.zeros(len(WALKING_JOINTS))
    run = JointRun(0, time, angle + 100.0, angle)
    data = transitions([run, run])
    np.testing.assert_array_equal(data.angle[0, :, 0], [4, 3, 2, 1, 0])
    np.testing.assert_array_equal(data.action[0, :, 0], [104, 103, 102, 101, 100])
    np.testing.assert_array_equal(data.following[:15, 0], np.arange(5, 20))
    assert data.angle.shape == (30, HISTORY + 1, len(WALKING))
    with pytest.raises(ValueError, match="longer"):
        transitions([JointRun(0, time[:5], angle[:5], angle[:5])])


def test_the_network_learns_angles_on_the_circle():
    generator = np.random.default_rng(0)
    inputs = generator.normal(size=(6000, 6))
    angle = np.stack([0.3 * inputs[:, 0], np.sin(inputs[:, 1] * inputs[:, 2])], -1)
    held_out = np.arange(6000) % 6 == 0
    network, fit = train(inputs, angle, held_out, seed=0)
    assert fit.validation_rmse < 0.3 * fit.linear_rmse
    found = jax.vmap(predict, in_axes=(None, 0))(network, inputs[held_out])
    error = np.asarray(found) - angle[held_out]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(fit.validation_rmse, rel=1e-3)


def test_an_input_that_never_moved_tells_nothing_when_it_does():
    rng = np.random.default_rng(0)
    inputs = rng.uniform(-0.5, 0.5, (600, 3))
    inputs[:, 2] = 0.3
    angle = np.sin(4.0 * inputs[:, :1]) ** 2 + inputs[:, 1:2]
    network, fit = train(inputs, angle, np.arange(600) > 500, seed=0)
    away = inputs + np.array([0.0, 0.0, 5e-3])
    assert fit.validation_rmse < 0.5 * fit.linear_rmse
    for row, other in zip(inputs[::100], away[::100], strict=True):
        np.testing.assert_array_equal(predict(network, row), predict(network, other))


def test_few_samples_train_the_layers_as_well():
    rng = np.random.default_rng(1)
    inputs = rng.uniform(-0.5, 0.5, (150, 2))
    angle = np.sin(4.0 * inputs[:, :1]) ** 2
    _, fit = train(inputs, angle, np.arange(150) > 110, seed=0)
    assert fit.validation_rmse < 0.7 * fit.linear_rmse


def test_forward_model_integrates_the_acceleration(world, logs):
    runs = to_arrays(logs["late"], WALKING_JOINTS)
    grounding = learn_grounding(world, "guided", logs["late"], logs["simulator"], 0)
    data = transitions(runs)
    error = next_angle_of(grounding.params.forward, data) - data.following
    still = data.angle[:, 0] - data.following
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(still**2))
