"""What each verb does; the dataclasses are in `arguments`."""

from __future__ import annotations

import shlex
import tempfile
from contextlib import closing, suppress
from functools import singledispatch
from pathlib import Path
from typing import Any

import jax
import numpy as np

import gatjax
from gatjax import loop, runs
from gatjax.cli import arguments as verbs
from gatjax.cli import logs, sharing
from gatjax.cli.collecting import counted, record, summary, upright
from gatjax.cli.inputs import (
    check_least,
    check_seconds,
    policy_of,
    robot_named,
    robot_of,
    walker_of,
)
from gatjax.cli.progress import shown, shown_beside
from gatjax.cli.resume import open_search, resumed
from gatjax.data.mapping import read_map
from gatjax.data.recording import read_recording
from gatjax.hardware.deploy import Asked
from gatjax.hardware.deploy import deploy as deployed
from gatjax.hardware.links import is_hardware
from gatjax.hardware.robot import Hardware
from gatjax.hardware.terminal import Terminal
from gatjax.hosts import address_of, serve
from gatjax.loop.setting import ORACLE
from gatjax.report import build_report, headline, onward
from gatjax.report.page import build_walk_page
from gatjax.runs import Progress
from gatjax.search import checked
from gatjax.settings import (
    EVALUATION,
    LoopSettings,
    SearchSettings,
    check_seed,
    seeds,
)
from gatjax.sim.backend import use_compile_cache
from gatjax.sim.poses import states, write_walk
from gatjax.sim.world import nominal
from gatjax.task import task_at
from gatjax.walk.parameters import THETA0


@singledispatch
def act(verb: Any) -> None:
    """Do what a verb's dataclass asks for."""
    raise TypeError(f"{type(verb).__name__} is no verb")


@act.register
def run(verb: verbs.Run) -> None:
    """Run the loop and write the report."""
    use_compile_cache()
    if verb.resume:
        folder, settings = resumed(verb)
    elif verb.run is not None:
        raise ValueError(f"--run {verb.run} goes with --resume; a new run takes --out")
    else:
        settings = loop.resolved(verb.loop)
        check_searchable(settings)
        robot = robot_named(settings.robot, settings.body_seed, verb.out)
        if isinstance(robot, Hardware):  # before there is a folder
            robot.check_rate(settings.rate_hz)
        device = str(jax.devices()[0])
        folder = runs.open_run(verb.out, settings, device=device).path
    print(f"run folder {folder}", flush=True)
    robot = robot_named(settings.robot, settings.body_seed, folder / "hardware")
    done: list[str] = []
    with shown_beside(settings.robot, loop.total_work(settings)) as progress:

        def stage(text: str) -> None:
            done.append(text)
            progress.stage(text)

        loop.run(folder, settings, robot, Progress(stage, progress.work, progress.past))
    if not done:
        print("this run was finished already; its report is written again")
    _reported(folder)


def check_searchable(settings: LoopSettings) -> None:
    """Refuse to search on a robot that is really there: it takes thousands of walks."""
    if ORACLE in settings.methods and is_hardware(settings.robot):
        raise ValueError(
            f"oracle searches on the robot itself, which {settings.robot} would not "
            f"live through; leave it out of --methods"
        )


def _reported(folder: Path) -> None:
    """Write the report of a run, and say what came out."""
    report = build_report(folder)
    print(headline(folder), f"report {report}", *onward(folder), sep="\n")


@act.register
def collect(verb: verbs.Collect) -> None:
    """Record walks or a motion of a robot."""
    record(verb)


@act.register
def ground(verb: verbs.Ground) -> None:
    """Learn a grounding and write it with its world file."""
    check_least(0, seed=verb.seed)
    task = task_at(verb.rate_hz)
    world = loop.ungrounded(verb.world, task)
    mapping = None if verb.map is None else read_map(verb.map)
    theta, key = policy_of(verb.policy), jax.random.key(verb.seed)
    robot = logs.checked(read_recording(verb.robot_log, mapping), world, least=4)
    simulator = logs.checked(read_recording(verb.simulator_log), world, least=2)
    logs.check_pair(robot, simulator)
    runs.make_folder(verb.out)
    logs.check_own(verb.out)
    with shown(3.0) as progress:
        progress.stage(f"{verb.method}: learn from {robot.name}")
        grounding = loop.learn_grounding(
            world, verb.method, robot, simulator, verb.seed, theta, progress.stage
        )
        progress.work(1.0)
        progress.stage(f"{verb.method}: choose alpha")
        grounding = loop.stable(world, grounding, theta, key)
        grounding = loop.helpful(world, grounding, robot, verb.seed, theta, key)
        progress.work(1.0)
        progress.stage(f"{verb.method}: predict held-out trajectories")
        rows = loop.predictions(world, grounding, robot, verb.seed)
        progress.work(1.0)
    made_by = {
        "method": verb.method,
        "seed": verb.seed,
        "robot_log": str(verb.robot_log),
        "simulator_log": str(verb.simulator_log),
        "gatjax": gatjax.__version__,
    }
    loop.write_grounded(verb.out, world, grounding, made_by)
    print(logs.table(rows))
    print(f"learned by {verb.method}: {logs.about(grounding.facts)}")
    print(f"{verb.out / 'world.json'}: --world of collect, search, evaluate, view")


@act.register
def search(verb: verbs.Search) -> None:
    """Search for a faster walk in one world."""
    use_compile_cache()
    check_least(0, seed=verb.seed)
    settings = checked(
        SearchSettings(
            population=verb.population,
            rollouts=verb.rollouts,
            generations=verb.generations,
            race=verb.race,
        )
    )
    chosen = loop.resolved(
        LoopSettings(
            model=verb.model, backend=verb.backend, impl=verb.impl, search=settings
        )
    )
    world = walker_of(verb.world, task_at(verb.rate_hz))
    key, theta = jax.random.key(verb.seed), policy_of(verb.policy)
    runs.make_folder(verb.out)
    keys = jax.random.split(key)
    job = loop.Job(verb.out, "search", 0, world, theta, *keys)
    units = settings.walks * settings.generations
    with runs.held(verb.out):
        left = open_search(verb, chosen, theta)
        with shown(float(units)) as progress, sharing.opened(verb, left) as share:
            last = loop.optimise(job, chosen, progress, share)[-1]
    path = verb.out / "policies" / f"{last.name}.json"
    print(f"{path}: mean of the last generation")
    usual = verb.rate_hz == verbs.Search.rate_hz
    rate = "" if usual else f" --rate-hz {verb.rate_hz:g}"
    print(f"try it: gatjax evaluate --policies {shlex.quote(str(path))}{rate}")


@act.register
def work(verb: verbs.Work) -> None:
    """Run a share of another host's search."""
    use_compile_cache()
    if not verb.patience >= 0.0:
        raise ValueError(f"--patience is {verb.patience}; use 0 or more seconds")
    answers = serve(
        address_of(verb.leader), lambda task: sharing.prepared(task, verb),
        verb.patience, sharing.say,
    )  # fmt: skip
    print(f"{verb.leader} is done; this host ran {answers} shares of its walks")


@act.register
def evaluate(verb: verbs.Evaluate) -> None:
    """Walk policies on a robot and print speed and falls."""
    check_least(1, runs=verb.runs)
    check_seed("--seed", verb.seed)
    check_least(0, body_seed=verb.body_seed)
    if not 0.0 < verb.forward <= 1.0:
        raise ValueError(f"--forward is {verb.forward}; use more than 0, at most 1")
    task = task_at(verb.rate_hz, forward=verb.forward)
    robot = robot_of(verb.robot, verb.body_seed, verb.world, task, verb.out, walker_of)
    clear = len({path.stem for path in verb.policies}) == len(verb.policies)
    named = {
        path.stem if clear else str(path): runs.read_policy(path)
        for path in verb.policies
    }
    named = named or {"theta0": THETA0}
    drawn = seeds(EVALUATION, verb.seed, verb.runs)
    found = {}
    with shown_beside(verb.robot, float(len(named))) as progress:
        for name, theta in named.items():
            progress.stage(f"{name}: {verb.runs} walks of {robot.name}")
            policies = np.tile(theta, (verb.runs, 1))
            _, found[name] = robot.walk(policies, drawn, task)
            progress.work(1.0)
    for name, outcome in found.items():
        many = counted(verb.runs, "run")
        print(f"{name} on {robot.name}: {summary(outcome)} in {many}{upright(outcome)}")


@act.register
def view(verb: verbs.View) -> None:
    """Show one walk."""
    check_least(0, seed=verb.seed, body_seed=verb.body_seed)
    if not verb.live and verb.out.suffix not in (".html", ".mp4"):
        raise ValueError(f"--out {verb.out}: a walk ends in .html or .mp4")
    task = task_at(verb.rate_hz)
    kept = verb.out.with_suffix("")
    robot = robot_of(verb.robot, verb.body_seed, verb.world, task, kept, walker_of)
    theta = policy_of(verb.policy)
    if not verb.live:
        if verb.out.suffix == ".mp4":
            from gatjax.cli.film import encoder

            encoder()  # told before the walk, if there is none
        runs.make_folder(verb.out.parent)
    walk, outcome = robot.walk(theta[None], [verb.seed], task)
    walk = jax.tree.map(lambda leaf: np.asarray(leaf)[0], walk)
    if not np.isfinite(walk.base.position[0]).all():
        raise ValueError(
            f"{robot.name} does not tell where its torso is, which takes motion "
            f"capture; gatjax deploy keeps a log of its joints"
        )
    model = nominal(task).model
    if verb.live:
        from gatjax.cli.window import play

        play(model, states(model, walk), task.control_period)
        return
    if verb.out.suffix == ".mp4":
        from gatjax.cli.film import film

        film(verb.out, model, states(model, walk), task.control_period)
        print(f"{verb.out}: a video ({summary(outcome)})")
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.npz"
        write_walk(file, model, walk, f"{robot.name}: {summary(outcome)}")
        fell = bool(np.isfinite(outcome.fell_at).any())
        build_walk_page(file, verb.out, fell)
    print(f"{verb.out}: open it in a browser ({summary(outcome)})")


@act.register
def deploy(verb: verbs.Deploy) -> None:
    """Let a robot walk a policy."""
    asked = Asked(verb.walks, verb.forward, verb.seconds)
    lines = deployed(verb.policy, verb.robot, asked, verb.out, Terminal())
    print(*lines, sep="\n")


@act.register
def simulate(verb: verbs.SimulateNao) -> None:
    """Serve a simulated NAO until Ctrl-C."""
    from gatjax.surrogate.attended import SimulatedNao
    from gatjax.surrogate.lola import Server

    check_least(0, seed=verb.seed, body_seed=verb.body_seed)
    robot = SimulatedNao(verb.robot, verb.body_seed, verb.seed, verb.hung)
    pace = "in lockstep" if verb.lockstep else "in real time"
    with closing(Server(verb.socket, verb.lockstep)) as server:
        print(
            f"{verb.robot} as a NAO at {verb.socket}, {pace}; Ctrl-C ends it",
            flush=True,
        )
        server.serve(robot, lambda text: print(text, flush=True))


@act.register
def report(verb: verbs.Report) -> None:
    """Write the report of a run folder."""
    folder = runs.latest_run("runs") if verb.run is None else verb.run
    runs.check_run(folder)
    _reported(folder)


@act.register
def bench(verb: verbs.Bench) -> None:
    """Measure and print steps/s."""
    check_least(1, worlds=verb.worlds)
    check_seconds(verb.seconds)
    if verb.json is not None:
        if verb.json.suffix != ".json" or verb.json.is_dir():
            raise ValueError(
                f"--json is {verb.json}; name a file FILE.json, the picture goes to "
                f"FILE.png beside it"
            )
        runs.make_folder(verb.json.parent)
    from gatjax import speed

    asked = speed.Asked(
        verb.backends, verb.models, verb.kinds, verb.worlds, verb.seconds
    )
    with shown(float(asked.rows)) as progress:
        found = speed.measure(asked, progress)
    print(speed.table(found["rows"]))
    if verb.json is not None:
        runs.write_json(verb.json, found)
        speed.draw(found["rows"], verb.json.with_suffix(".png"))
        print(f"{verb.json} and {verb.json.with_suffix('.png')}")


@act.register
def diagnose(verb: verbs.Diagnose) -> None:
    """Say what a simulation gets wrong."""
    from gatjax.cli.diagnosis import explain, read_given

    check_least(0, seed=verb.seed)
    use_compile_cache()
    given = read_given(verb)
    runs.make_folder(verb.out)
    try:
        explain(verb, *given)
    finally:
        with suppress(OSError):
            verb.out.rmdir()  # nothing came of it, and nothing is in it


@act.register
def bench_diagnose(verb: verbs.BenchDiagnose) -> None:
    """Measure the diagnosis on cases with known answers."""
    from gatjax.cli.blind import measure

    check_least(0, seed=verb.seed)
    check_least(1, jobs=verb.jobs, cases=1 if verb.cases is None else verb.cases)
    runs.make_folder(verb.out)
    measure(verb)


@act.register
def doctor(verb: verbs.Doctor) -> None:
    """Check the installation."""
    from gatjax.cli.doctor import BROKEN, examine

    del verb
    broken = []
    for name, finding in examine():
        print(f"{name:<16} {finding}")
        broken += [name] if finding.startswith(BROKEN) else []
    if broken:
        raise ValueError(f"{', '.join(broken)}: not as it should be, see above")
