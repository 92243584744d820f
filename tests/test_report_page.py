"""The report: what it says follows the files, and it always says something."""

import base64
import csv
import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest

from gatjax.report import build_report, onward
from gatjax.report.page import build_walk_page
from gatjax.report.walks import pack, read_walk
from gatjax.runs import add_rows
from gatjax.walk.parameters import PARAMETERS

SPREAD = (-0.004, -0.002, 0.0, 0.002, 0.004)  # m/s, one walk each
EVALUATIONS = "method,iteration,generation,candidate,seed,velocity_m_s,fell_at_s"
COLUMNS = EVALUATIONS.split(",")
METRICS = (
    "method,iteration,generation,candidate,simulator_cost,simulator_velocity_m_s,"
    "simulator_falls,sigma,robot_velocity_m_s,robot_falls,robot_rollouts,seconds"
)
PREDICTION = "method,iteration,joint,horizon_s,before_rad,after_rad"
# (velocity m/s, falls of 5) of generations 0, 1, 2
THETA0 = [(0.18, 0)]
FALLING = [(0.19, 0), (0.20, 0), (0.24, 5)]
GOOD = [(0.19, 0), (0.22, 0), (0.25, 0)]


def write_table(path, header, rows):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header.split(","))
        writer.writerows(rows)


def evaluation_rows(methods):
    for method, generations in methods.items():
        for generation, (velocity, falls) in enumerate(generations):
            for seed, change in enumerate(SPREAD):
                fell_at = 2.5 if seed < falls else ""
                row = [method, 0, generation, "best", seed, velocity + change, fell_at]
                yield row


def metric_rows(methods):
    for method, generations in methods.items():
        for generation, (velocity, falls) in enumerate(generations):
            for candidate in ("best", "mean"):
                own = [method, 0, generation, candidate, -velocity, velocity, 0, 0.5]
                robot = [velocity, falls, 5] if candidate == "best" else ["", "", ""]
                yield own + robot + [7.5]


def write_policy(folder, name, **changes):
    values = {
        parameter.name: {
            "value": changes.get(parameter.name, parameter.theta0),
            "unit": parameter.unit,
        }
        for parameter in PARAMETERS
    }
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.json").write_text(json.dumps({"parameters": values}))


def write_walk(path, frames=20, label="a walk"):
    path.parent.mkdir(exist_ok=True)
    time = 0.04 * np.arange(frames)
    position = np.zeros((frames, 3, 3))
    position[:, 1] = np.stack([0.2 * time, 0.0 * time, 0.3 + 0.0 * time], axis=-1)
    position[:, 2] = position[:, 1] + [0.0, 0.05, 0.2]
    quaternion = np.zeros((frames, 3, 4))
    quaternion[..., 0] = 1.0
    np.savez(
        path,
        time=time,
        body_position=position,
        body_quaternion=quaternion,
        geom_body=np.array([1, 1, 2]),
        geom_type=np.array(["box", "capsule", "sphere"]),
        geom_size=np.array([[0.04, 0.05, 0.06], [0.03, 0.1, 0.0], [0.06, 0.0, 0.0]]),
        geom_position=np.zeros((3, 3)),
        geom_quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)),
        geom_rgba=np.full((3, 4), 0.8),
        label=np.array(label),
    )


def write_run(folder, **methods):
    """Write a whole run folder; each method is a list of (velocity, falls of 5)."""
    folder.mkdir(exist_ok=True)
    (folder / "config.json").write_text('{"seed": 3, "search": {"population": 40}}')
    (folder / "environment.json").write_text('{"mujoco": "4.0.0"}')
    (folder / "robot.json").write_text('{"name": "dart", "delay_s": 0.036}')
    write_table(folder / "evaluations.csv", EVALUATIONS, evaluation_rows(methods))
    write_table(folder / "metrics.csv", METRICS, metric_rows(methods))
    errors = [
        ["gat", 0, joint, horizon, 0.02, 0.01]
        for joint in ("LHipPitch", "RKneePitch")
        for horizon in (0.02, 0.5)
    ]
    write_table(folder / "prediction.csv", PREDICTION, errors)
    write_policy(folder / "policies", "theta0")
    write_policy(folder / "policies", "gat_0_2_best", max_forward=0.38, arm_swing=14.0)
    write_walk(folder / "walks" / "theta0_robot.npz", label="theta0 on the robot")
    write_walk(folder / "walks" / "gat_best_robot.npz", label="GAT on the robot")
    return folder


def write_default(folder):
    return write_run(folder, theta0=THETA0, none=FALLING, gat=GOOD)


def page_of(folder):
    return build_report(folder).read_text()


def shown(page):
    """Text a reader sees: without scripts, styles and tags."""
    page = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", page).split())


def packed_walks(page):
    return json.loads(re.search(r'id="walks">(.*?)</script>', page, re.DOTALL)[1])


def test_page_needs_no_network(tmp_path):
    page = page_of(write_default(tmp_path))
    assert "http" not in page
    assert not re.search(r"<(link|img|iframe)\b|@import|\ssrc=", page)
    assert not re.search(r"href\s*=\s*[\"'](?!#)", page)
    assert page.count("<script") == 2


def test_page_shows_every_part_of_a_whole_run(tmp_path):
    page = page_of(write_default(tmp_path))
    text = shown(page)
    assert "This run is not complete" not in text
    for part in ("25.0 24.6 to 25.4", "+38.9 %", "19.52", "7 of 10", "1 of 10"):
        assert part in text, part
    assert page.count("<svg") == 6  # velocity, falls, two costs, two horizons
    assert "velocity, cm/s" in page and "prediction error (rms), degrees" in page
    assert "search.population 40" in text and "mujoco 4.0.0" in text
    assert "GAT 22.5 s" in text  # three generations of 7.5 s, not six rows


@pytest.mark.parametrize(
    "lost",
    [
        "config.json",
        "environment.json",
        "robot.json",
        "metrics.csv",
        "prediction.csv",
        "evaluations.csv",
        "policies",
        "walks",
    ],
)
def test_missing_part_is_named_and_the_rest_shown(tmp_path, lost):
    folder = write_default(tmp_path / "run")
    (folder / lost).rename(tmp_path / lost)
    text = shown(page_of(folder))
    assert re.search(rf"{lost}/? is missing", text)
    assert "The 15 parameters" in text and "Methods on the robot" in text


def test_empty_folder_gives_a_page(tmp_path):
    text = shown(page_of(tmp_path))
    assert "No verdict yet: nothing has walked on the robot" in text


def test_damaged_files_are_named(tmp_path):
    folder = write_default(tmp_path)
    with (folder / "evaluations.csv").open("a") as file:
        file.write("gat,0,2,be")
    (folder / "config.json").write_text('{"seed": ')
    (folder / "walks" / "gat_best_robot.npz").write_bytes(b"PK\x03\x04cut")
    text = shown(page_of(folder))
    assert "evaluations.csv line 37 left out" in text
    assert "config.json cannot be read" in text
    assert "walks/gat_best_robot.npz cannot be shown" in text
    assert "Grounding (GAT) beat no grounding" in text


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="is not a folder"):
        build_report(tmp_path / "nowhere")


def test_no_nan_reaches_the_reader(tmp_path):
    folder = write_default(tmp_path)
    (folder / "config.json").write_text('{"alpha": NaN, "cap": Infinity}')
    with (folder / "metrics.csv").open("a") as file:
        file.write("gat,0,3,best,nan,nan,,,,,,\n")
    with (folder / "evaluations.csv").open("a") as file:
        file.write("gat,0,3,best,0,nan,\nguided,0,0,best,0,0.2,inf\n")
    with (folder / "prediction.csv").open("a") as file:
        file.write("gat,0,LHipRoll,0.5,nan,inf\n")
    page = page_of(folder)
    assert not re.search(r"\b(nan|inf)\b", shown(page), re.IGNORECASE)
    pictures = "".join(re.findall(r"<svg.*?</svg>", page, re.DOTALL))
    assert not re.search(r"\b(nan|inf)\b", pictures, re.IGNORECASE)
    packed_walks(page)


def test_text_from_files_cannot_become_html(tmp_path):
    folder = write_default(tmp_path)
    (folder / "robot.json").write_text('{"name": "<script>alert(1)</script>"}')
    write_walk(folder / "walks" / "theta0_robot.npz", label="</script><b>")
    page = page_of(folder)
    assert "<script>alert" not in page
    assert packed_walks(page)[0]["label"] == "</script><b>"


def test_first_and_best_walk_come_first(tmp_path):
    folder = write_default(tmp_path)
    write_walk(folder / "walks" / "envelope_best_robot.npz")
    names = [walk["name"] for walk in packed_walks(page_of(folder))]
    assert names == ["theta0_robot", "gat_best_robot", "envelope_best_robot"]


def test_confirmation_walks_stand_for_the_winner(tmp_path):
    folder = write_default(tmp_path)
    before = page_of(folder)
    assert "The winners were not confirmed" in before
    rows = [
        ["gat", 0, 2, "chosen", 100 + seed, 0.215 + change, 1.5 if seed == 4 else ""]
        for seed, change in enumerate(SPREAD)
    ]
    add_rows(
        folder / "evaluations.csv", [dict(zip(COLUMNS, r, strict=True)) for r in rows]
    )
    robot = ["", "", "", "", 0.215, 1, 5, 60.0]
    with (folder / "metrics.csv").open("a", newline="") as file:
        csv.writer(file).writerow(["gat", 0, 2, "chosen", *robot])
    page = page_of(folder)
    text = shown(page)
    assert "The winners were not confirmed" not in text
    assert "GAT 21.4 cm/s +19 %, 1 of 5 confirmation walks fell, 0 % falls" in text
    assert "25.0" not in text.partition("Cost per generation")[0]
    assert "1 of 5 confirmation walks fell" in text and "0 of 10" in text
    assert "generation 2, best" in text  # the policy that was walked again
    assert "GAT 22.5 s" in text  # confirmation is no search
    pictures = [
        re.findall(r"<svg.*?</svg>", each, re.DOTALL) for each in (before, page)
    ]
    assert pictures[0] == pictures[1]


def test_the_policy_of_the_first_and_how_to_walk_it_are_told(tmp_path):
    folder = write_default(tmp_path)
    policy = folder / "policies" / "gat_0_2_best.json"
    assert policy.is_file()
    walked = f"gatjax evaluate --policies {policy}"
    text = shown(page_of(folder))
    assert "policies/gat_0_2_best.json" in text and walked in text
    config = json.loads((folder / "config.json").read_text())
    config |= {"robot": "stiff", "body_seed": 3, "rate_hz": 50.0}
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "robot.json").write_text('{"name": "stiff"}')
    policy_line, again, deploy = onward(folder)
    assert policy_line == f"policy {policy}, from GAT"
    assert again == f"walk it again: {walked} --robot stiff --body-seed 3"
    assert deploy == f"on a NAO: gatjax deploy {policy} --robot lola"


def test_commands_of_the_first_can_be_typed_and_name_no_unknown_robot(tmp_path):
    folder = write_default(tmp_path / "my runs")
    policy = folder / "policies" / "gat_0_2_best.json"
    config = json.loads((folder / "config.json").read_text()) | {"robot": "dart"}
    (folder / "config.json").write_text(json.dumps(config))
    for robot, known in (
        ({"name": "dart"}, True), ({"name": "nao", "address": "dart"}, True),
        ({"name": "my-nao"}, False), ({"name": "my-nao", "address": "x"}, False),
    ):  # fmt: skip
        (folder / "robot.json").write_text(json.dumps(robot))
        lines = onward(folder)
        again = f"walk it again: gatjax evaluate --policies '{policy}' --robot dart"
        assert (again in lines) is known
        assert lines[-1] == f"on a NAO: gatjax deploy '{policy}' --robot lola"
        assert ("Walk it again" in shown(page_of(folder))) is known


def test_a_robots_constants_are_rounded_and_have_their_units(tmp_path):
    folder = write_default(tmp_path)
    facts = {"constants": {"play": 0.008726646259971648, "share": 0.6, "side": 12.0}}
    facts |= {"name": "dart", "units": {"play": "rad", "side": "m"}}
    (folder / "robot.json").write_text(json.dumps(facts))
    text = shown(page_of(folder))
    assert (
        "constants.play 0.008727 rad constants.share 0.6 constants.side 12.0 m" in text
    )
    assert "units.play" not in text


def test_a_walk_has_the_name_of_its_method_and_says_that_it_fell(tmp_path):
    folder = write_default(tmp_path)
    path = folder / "walks" / "none_best_robot.npz"
    write_walk(path, label="best of none on dart")
    rows = [
        ["none", 0, 2, "chosen", 100 + n, 0.2, 1.5 if n == 0 else ""] for n in (1, 0)
    ]
    with (folder / "evaluations.csv").open("a", newline="") as file:
        csv.writer(file).writerows(rows)
    walks = {walk["name"]: walk for walk in packed_walks(page_of(folder))}
    assert walks["none_best_robot"]["label"] == "no grounding on dart"
    assert walks["none_best_robot"]["fell"] and not walks["theta0_robot"]["fell"]


def test_one_walk_alone_is_neither_the_first_nor_the_best(tmp_path):
    write_walk(tmp_path / "walk.npz")
    build_walk_page(tmp_path / "walk.npz", tmp_path / "walk.html")
    page = (tmp_path / "walk.html").read_text()
    assert "The walk" in shown(page) and "the best walk" not in shown(page)


def test_packed_walk_is_the_walk(tmp_path):
    write_walk(tmp_path / "walk.npz")
    walk = read_walk(tmp_path / "walk.npz")
    packed = pack(walk)
    whole = np.frombuffer(base64.b64decode(packed["position"]), "<i2")
    position = whole.reshape(20, 2, 3) * packed["scale"]  # the unused body is dropped
    np.testing.assert_allclose(position[:, 0, 0], 0.2 * walk.time, atol=1e-5)
    np.testing.assert_allclose(position[:, 1, 2], 0.5, atol=1e-5)
    turns = np.frombuffer(base64.b64decode(packed["quaternion"]), "<i2")
    assert set(turns.reshape(-1, 4)[:, 0]) == {32767}
    assert [part["body"] for part in packed["geometry"]] == [0, 0, 1]


def test_walk_ends_before_its_first_nan(tmp_path):
    write_walk(tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz") as file:
        arrays = dict(file)
    arrays["body_position"][7:] = math.nan
    np.savez(tmp_path / "walk.npz", **arrays)
    assert len(read_walk(tmp_path / "walk.npz").time) == 7


def test_a_robot_that_nobody_saw_lacks_nothing(tmp_path):
    folder = write_default(tmp_path)
    for path in (folder / "walks").glob("*.npz"):
        with np.load(path) as file:
            arrays = dict(file)
        arrays["body_position"][:] = math.nan
        np.savez(path, **arrays)
    page = page_of(folder)
    assert "This run is not complete" not in page
    assert "which takes motion capture" in page


def test_page_stays_small(tmp_path):
    folder = write_default(tmp_path)
    for index in range(60):
        write_walk(folder / "walks" / f"m{index}_best_robot.npz", frames=3000)
    assert build_report(folder).stat().st_size < 5_000_000


def test_parameters_change_in_steps(tmp_path):
    text = shown(page_of(write_default(tmp_path)))
    assert "max_forward speed at request 1 m/s 0.3 0.38 +2.0 steps" in text
    assert "arm_swing arm against leg rad/m 6 14 +8.0 steps, at its bound" in text


def test_an_old_report_survives_a_failed_write(tmp_path, monkeypatch):
    folder = write_default(tmp_path)
    (folder / "report.html").write_text("old")

    def full(*_):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr("gatjax.files.os.replace", full)
    with pytest.raises(OSError, match="no space"):
        build_report(folder)
    assert (folder / "report.html").read_text() == "old"
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_same_folder_gives_the_same_page(tmp_path):
    folder = write_default(tmp_path)
    assert page_of(folder) == page_of(folder)


def test_report_loads_no_simulator():
    code = (
        "import sys, gatjax.report\n"
        "heavy = {'jax', 'mujoco', 'gatjax.sim', 'matplotlib.pyplot'}\n"
        "sys.exit(' '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
