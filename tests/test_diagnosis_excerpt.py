"""Long logs are cut into pieces, short ones stay as they are."""

import numpy as np
import pytest

import gatjax.surrogate.hidden
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import loads, motion
from gatjax.diagnosis.assembly import build
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.excerpt import PIECE, excerpt, shortened
from gatjax.diagnosis.joint import STEP
from gatjax.diagnosis.measure import whole_log
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.tolerances import USUAL
from gatjax.robot.model import joint_names
from gatjax.sim.world import nominal
from gatjax.task import Task


def log(*seconds, rate=50.0):
    """A recording of runs that last so long, whose position is the time."""
    times = [np.arange(0.0, each + 1e-9, 1.0 / rate) for each in seconds]
    run = [np.full(len(time), 7 + k) for k, time in enumerate(times)]
    time = np.concatenate(times)
    return Recording("log", time, np.concatenate(run), {"position.a": time.copy()}, {})


def lasts(cut):
    return [
        np.ptp(cut.time[cut.trajectory == run]) for run in np.unique(cut.trajectory)
    ]


def test_short_logs_stay_as_they_are():
    logs = [log(60.0), log(60.0, 20.0)]
    assert all(a is b for a, b in zip(excerpt(logs, 6), logs, strict=True))
    assert shortened(logs, 6) is None


def chirped(seconds, rate=50.0):
    """A recording that moves faster and faster."""
    one = log(seconds, rate=rate)
    angle = np.sin(0.05 * one.time**2)
    return one._replace(columns={"position.a": angle, "time": one.time.copy()})


def test_long_logs_become_pieces_from_calm_to_lively():
    logs = [chirped(120.0), chirped(240.0)]
    first, second = excerpt(logs, 20)
    assert len(lasts(first)) == 3 and len(lasts(second)) == 7
    for cut in (first, second):
        assert lasts(cut) == pytest.approx([PIECE] * len(lasts(cut)), abs=0.03)
        assert cut.time == pytest.approx(cut.columns["time"])
    middles = [first.time[first.trajectory == k].mean() for k in range(3)]
    assert middles == pytest.approx([21.0, 63.0, 105.0], abs=0.05)


def test_a_log_that_is_calm_but_for_a_moment_keeps_that_moment():
    one = log(400.0)
    angle = np.where((one.time > 250.0) & (one.time < 253.0), np.sin(9.0 * one.time), 0)
    (cut,) = excerpt([one._replace(columns={"position.a": angle})], 20)
    assert np.ptp(cut.columns["position.a"]) > 1.5


def test_pieces_of_trajectories_that_take_turns_are_those_of_each():
    """Between two rows of a file the robot may be another one; no speed is in that."""
    calm = log(400.0)
    apart = np.where(calm.time > 250.0, 3.0, 0.0)  # where the other one stands
    lively = np.where(
        (calm.time > 50.0) & (calm.time < 53.0), np.sin(9.0 * calm.time), 0
    )
    columns = [{"position.a": lively}, {"position.a": apart}]
    alone = [calm._replace(columns=each) for each in columns]
    turns = np.argsort(np.tile(calm.time, 2), kind="stable")
    both = calm._replace(
        time=np.tile(calm.time, 2)[turns],
        trajectory=np.repeat([0, 1], len(calm.time))[turns],
        columns={"position.a": np.append(lively, apart)[turns]},
    )
    (cut,) = excerpt([both], 20)
    first = excerpt(alone, 20)[0]
    count = len(lasts(first))
    assert np.ptp(first.columns["position.a"]) > 1.5
    assert cut.time[cut.trajectory < count] == pytest.approx(first.time)
    assert lasts(cut) == pytest.approx([PIECE] * 2 * count, abs=0.03)


def test_of_many_short_runs_every_so_many_th_is_taken_whole():
    every = log(*[5.0] * 80)
    numbered = every._replace(columns={"position.a": 0.0 + every.trajectory})
    (cut,) = excerpt([numbered], 20)
    assert lasts(cut) == pytest.approx([5.0] * 12, abs=0.03)  # 60 s
    taken = np.unique(cut.columns["position.a"])
    assert set(np.diff(taken)) == {6.0, 7.0}


def test_a_log_of_which_nothing_is_taken_is_left_out():
    short = [log(5.0) for _ in range(80)]
    assert len(excerpt(short, 20)) == 12


def test_the_user_is_told():
    told = shortened([log(400.0)], 20)
    assert "400 s" in told and "60 s of them" in told and "\n" not in told


@pytest.fixture(scope="module")
def piece():
    """A run whose command stands at 0.5 rad, cut out where the joint sags to 0.2."""
    time = 0.01 * np.arange(300)
    command, angle = np.full((300, 1), 0.5), np.full((300, 1), 0.2)
    return JointRun(0, time, command, angle, within=True)


WEIGHTLESS = """
<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
  <joint name="a" axis="0 1 0" armature="0.01" damping="0.4"/>
  <geom size="0.05" pos="0 0 -0.15" mass="0.5"/></body></worldbody>
<actuator><position joint="a" kp="20" kv="0.2"/></actuator></mujoco>"""


def test_a_piece_starts_as_it_was_measured(piece, tmp_path):
    """Its servo goes where it is told within the lead, and holds the joint there."""
    path = tmp_path / "arm.xml"
    path.write_text(WEIGHTLESS)
    world = nominal(Task(control_period=0.01), path)
    runs = [piece, piece._replace(within=False)]
    first = [angle[0, 0] for angle in whole_log(world, runs)]
    assert first == pytest.approx([0.2, 0.5], abs=1e-3)


def test_the_first_second_of_a_piece_does_not_count(piece):
    folder = gatjax.surrogate.hidden.__path__[0]
    start = Start(f"{folder}/arm_servo.xml")
    model = start.model()
    for run, counted in ((piece, 199), (piece._replace(within=False), 300)):
        (joint,) = prepared(model, [run])
        assert joint.valid.sum() == counted
        assert float(joint.grid.target[0, 0]) == pytest.approx(run.angle[0, 0]
            if run.within else run.command[0, 0], abs=1e-6)  # fmt: skip


def test_what_builds_up_over_minutes_is_not_looked_for_in_pieces(piece):
    folder = gatjax.surrogate.hidden.__path__[0]
    model = Start(f"{folder}/arm_servo.xml").model()
    for run, there in ((piece, False), (piece._replace(within=False), True)):
        (joint,) = prepared(model, [run])
        causes = {each.cause for each in of_drive(joint, CAUSES)}
        assert ("clock_drift" in causes) is there
        assert ("thermal_derating" in causes) is there
        assert "load_friction" in causes


def prepared(model, runs):
    """Joints of runs, ready to be fitted."""
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    fine = motion.grid_time(runs, STEP)[:: motion.FINE]
    moved = [motion.smoothed(run, run.angle, fine) for run in runs]
    others = [loads.perturbed(model, USUAL, np.random.default_rng(0))
              for _ in range(loads.TERMS)]  # fmt: skip
    weighed = [loads.weigh(tree, each, others) for each in moved]
    return build(model, tree, joint_names(model), runs, moved, weighed)


@pytest.mark.parametrize("seconds", [1.2, 2.0, 4.0, 9.0])
def test_many_short_runs_are_as_long_together_as_is_told(seconds):
    many = log(*[seconds] * round(240.0 / seconds))
    assert "60 s of them" in (shortened([many], 10) or "")
    (found,) = excerpt([many], 10)
    assert sum(lasts(found)) == pytest.approx(60.0, abs=6.0)


@pytest.mark.parametrize(
    ("runs", "most"), [((17.0,) * 9, 60.0), ((120.0, *(20.0,) * 3), 60.0)]
)
def test_runs_have_as_many_pieces_as_there_is_time_for(runs, most):
    found = excerpt([log(*runs)], 10)
    seconds = sum(sum(lasts(each)) for each in found)
    assert 59.0 < seconds <= most
    assert f"{seconds:.0f} s of them" in (shortened([log(*runs)], 10) or "")


def test_the_end_of_a_run_is_looked_at_if_it_is_lively():
    time = np.arange(0.0, 11.9, 0.02)
    angle = np.where(time < 7.0, 0.0, np.sin(9.0 * time))
    every = log(*[time[-1]] * 14)
    every = every._replace(columns={"position.a": np.tile(angle, 14)})
    (found,) = excerpt([every], 10)
    assert np.ptp(found.columns["position.a"]) > 1.9
