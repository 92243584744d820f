import json
import pathlib
import re

import mujoco
import numpy as np

from gatjax import task as tasks
from gatjax.data.mapping import read_map
from gatjax.data.recording import check_recording, read_recording
from gatjax.records import JOINTS, Base, Reading
from gatjax.robot.model import slots
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.episode import observe
from gatjax.sim.world import nominal
from gatjax.surrogate import make_robot
from gatjax.walk.parameters import THETA0

ROOT = pathlib.Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def replaced(text, old, new):
    assert text.count(old) == 1, f"the README no longer has {old!r}"
    return text.replace(old, new)


class Link:
    """The robot of the README's `connect`: MuJoCo, stepped tick by tick."""

    def __init__(self, angles):
        self.world = nominal()
        self.slots = slots(self.world.model)
        self.data = mujoco.MjData(self.world.model)
        self.data.qpos[2], self.data.qpos[3] = 0.315, 1.0
        self.data.qpos[self.slots.position] = angles
        mujoco.mj_forward(self.world.model, self.data)

    def read(self):
        state = (self.data.qpos, self.data.qvel, self.data.sensordata)
        plant = observe(self.slots, *(part.copy() for part in state))
        return plant.reading, plant.base

    def send(self, target):
        self.data.ctrl[:] = target
        mujoco.mj_step(self.world.model, self.data, self.world.substeps)


def test_api_example_runs(capsys):
    sizes = "runs, seconds, population, generations = 30, 7.5, 40, 5"
    small = "runs, seconds, population, generations = 4, 1.5, 4, 2"
    exec(replaced(blocks("python")[0], sizes, small), {})
    printed = capsys.readouterr().out.splitlines()
    starts = ["generation 0:", "generation 1:", "theta0:", "found:"]
    assert [line[: len(s)] for line, s in zip(printed, starts, strict=True)] == starts
    assert re.fullmatch(r"theta0: \d+\.\d cm/s, 0 falls", printed[2])


def test_api_example_is_short():
    code = [line for line in blocks("python")[0].splitlines() if line.strip()]
    assert len([line for line in code if "import" not in line]) <= 25


def test_own_robot_walks():
    names = {"connect": Link}
    exec(blocks("python")[1], names)
    task = tasks.Task(duration=1.5)
    robot = names["MyNao"]()
    trajectory, outcome = robot.walk(np.tile(THETA0, (2, 1)), [0, 1], task)
    assert trajectory.command.shape == (2, task.ticks, len(JOINTS))
    assert isinstance(trajectory.reading, Reading) and isinstance(trajectory.base, Base)
    assert np.isinf(outcome.fell_at).all()
    assert (outcome.velocity > 0.1).all()  # theta0 walks 0.2 m/s once it is up to speed
    assert json.loads(json.dumps(robot.constants()))
    assert robot.name == "my-nao"


def test_loop_example_runs(tmp_path, monkeypatch, short_walks):
    monkeypatch.chdir(tmp_path)
    tiny = LoopSettings(
        methods=("none",),
        robot_trajectories=5,
        simulator_trajectories=4,
        evaluations=1,
        search=SearchSettings(population=4, rollouts=1, generations=1),
        backend="native",
    )
    names = {"MyNao": lambda: make_robot("stiff"), "TINY": tiny}
    demo = 'replace(DEMO, methods=("none", "gat"), evaluations=2)'
    exec(replaced(blocks("python")[2], demo, "TINY"), names)
    assert "theta0" in (names["folder"] / "report.html").read_text(encoding="utf-8")


def test_map_example_translates(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(blocks("yaml")[0])
    log = tmp_path / "mine.csv"
    header = ["stamp_ms", "run", "comment", "diag_bus"]
    header += [f"{kind}_{joint}" for joint in JOINTS for kind in ("target", "angle")]
    rows = [[str(20 * n), "7", "0", "0", *["10"] * 2 * len(JOINTS)] for n in range(3)]
    log.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    recording = read_recording(log, read_map(path))
    check_recording(recording, JOINTS)
    np.testing.assert_allclose(recording.time, [0.0, 0.02, 0.04])
    assert recording.trajectory.tolist() == [7, 7, 7]
    columns = recording.columns
    np.testing.assert_allclose(columns["command.RHand"], np.deg2rad(10.0))
    np.testing.assert_allclose(columns["position.LKneePitch"], np.deg2rad(-8.5))


def test_every_verb_is_in_the_table():
    from gatjax.cli.arguments import VERBS

    table = re.findall(r"^\| `(\w+)` \|.*`gatjax (\w+)[^`]*` \|$", README, flags=re.M)
    assert [verb for verb, _ in table] == list(VERBS)
    assert [verb for verb, _ in table] == [example for _, example in table]


def test_command_lines_parse():
    from gatjax.cli.arguments import VERBS
    from gatjax.cli.parsing import parse

    lines = re.findall(r"(?:^ {4}|`)gatjax ([^`\n#]+)", README, flags=re.M)
    parsed = [parse(line.split()) for line in lines if line.split()[0] in VERBS]
    assert len(parsed) > len(VERBS)


def leads_somewhere(link: str) -> bool:
    """Whether a link's file, or the README, exists and, behind a #, a heading of it."""
    file, _, place = link.partition("#")
    file = file or "README.md"
    if not place or not (ROOT / file).is_file():
        return (ROOT / file).is_file()
    text = (ROOT / file).read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.+)$", text, flags=re.M)
    return place in [
        re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings
    ]


def test_linked_files_exist():
    links = re.findall(r"\]\((?!http)([^)]+)\)", README)
    assert "docs/report.png" in links
    assert [link for link in links if not leads_somewhere(link)] == []
    assert not leads_somewhere("docs/speed.md#no-such-heading")
