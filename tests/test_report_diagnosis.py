"""The page of a diagnosis: it says what the files say, and shows what they show."""

import functools
import json
import re
import subprocess
import sys
from html.parser import HTMLParser

import mujoco
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from gatjax.report.diagnosis import write_report
from gatjax.report.diagnosis.joints import trend
from gatjax.report.diagnosis.read import Signals, Trace
from gatjax.report.diagnosis.response import response
from gatjax.report.diagnosis.signals import binned, close_up, speed, thinned

RATE = 100.0  # Hz
STEP = 2 * np.pi / 4096
PENDULUM = """
<mujoco><option timestep="0.002"/><worldbody><body pos="0 0 1">
  <joint name="servo" axis="0 1 0" armature="0.012" damping="0.5" frictionloss="{dry}"/>
  <inertial pos="0 0 -0.17" mass="{mass}" diaginertia="0.002 0.002 0.0004"/>
</body></worldbody>
<actuator>
  <position joint="servo" kp="20" kv="0.25" forcerange="-5 5"/>
</actuator></mujoco>
"""


def command(kind, seconds):
    when = np.arange(0.0, seconds, 1.0 / RATE)
    slow = 0.5 * np.sin(2 * np.pi * 0.15 * when)
    if kind == "chirp":
        slow = slow + 0.15 * np.sin(2 * np.pi * (0.2 + 0.12 * when) * when)
    else:
        slow = 0.35 * np.sign(np.sin(2 * np.pi * 0.3 * when)) + 0.3 * slow
    return when, slow * np.clip(when - 0.5, 0.0, 1.0)


def simulate(sent, dry=0.06, mass=0.62, delay=0, push=0.0):
    """Angle and load torque at every command of a pendulum with one servo."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(dry=dry, mass=mass))
    data = mujoco.MjData(model)
    angle, load = [], []
    late = np.concatenate([np.full(delay, sent[0]), sent])
    for target in late[: len(sent)]:
        angle.append(data.qpos[0])
        load.append(data.qfrc_bias[0])
        data.ctrl[0] = target
        data.qfrc_applied[0] = push * np.sin(2 * np.pi * 1.7 * data.time)
        mujoco.mj_step(model, data, 5)
    return np.array(angle), np.array(load)


EFFECTS = {
    "none": ({"mass": 0.63}, {"mass": 0.63}),
    "named": ({"dry": 0.5}, {"dry": 0.48}),
    "ambiguous": ({"delay": 4}, {"delay": 4}),
    "unknown": ({"push": 1.0}, {}),
}
CAUSES = {
    "none": [],
    "named": [("coulomb_friction", "torque", 0.42, "N*m", [])],
    "ambiguous": [("command_delay", "delay", 0.04, "s", ["measurement_delay"])],
    "unknown": [],
}
SENTENCES = {
    "none": "The logs agree with the model; 0.11 N m of dry friction would have shown.",
    "named": "The servo has 0.42 N m more dry friction than the model; it holds on "
    "logs that were not fitted, where the error falls by 80 %.",
    "ambiguous": "Something delays the servo by 40 ms; the logs cannot tell whether it "
    "is the command or the measurement.",
    "unknown": "The servo is pushed about once in 0.6 s by something that no known "
    "cause explains.",
}


@functools.cache
def signals(verdict, names):
    """The table of signals, every joint a pendulum of its own."""
    real, extended = EFFECTS[verdict]
    random = np.random.default_rng(5)
    made = {}
    for part, (kind, seconds) in enumerate((("chirp", 12.0), ("steps", 8.0))):
        when, sent = command(kind, seconds)
        own = {"time": when, "trajectory": 0 * when, "part": part + 0 * when}
        measured, _ = simulate(sent, **real)
        nominal, load = simulate(sent)
        better, _ = simulate(sent, **extended)
        for row, name in enumerate(names):
            noisy = measured if row == 0 else nominal
            noisy = noisy + random.normal(0.0, 5e-4, len(when))
            own[f"command.{name}"] = sent
            own[f"measured.{name}"] = STEP * np.round(noisy / STEP)
            own[f"nominal.{name}"], own[f"load.{name}"] = nominal, load
            own[f"extended.{name}"] = better if row == 0 else nominal
        for name, values in own.items():
            made.setdefault(name, []).append(values)
    return {name: np.concatenate(parts) for name, parts in made.items()}


def described(verdict, columns, names):
    """A diagnosis.json with every key, its numbers taken from the signals."""
    fit = columns["part"] == 0

    def rms(joint, model, rows):
        rest = columns[f"measured.{joint}"] - columns[f"{model}.{joint}"]
        return float(np.sqrt(np.mean(np.square(rest[rows]))))

    causes = [
        {
            "cause": cause,
            "where": [names[0]],
            "parameters": {
                name: {"value": v, "low": 0.9 * v, "high": 1.1 * v, "unit": unit}
            },
            "probability": 0.96 if verdict == "named" else 0.5,
            "equivalent": equivalent,
        }
        for cause, name, v, unit, equivalent in CAUSES[verdict]
    ]
    others = ["measurement_delay", "stiction", "backlash", "load_friction", "payload"]
    residual = rms(names[0], "extended", fit)
    candidates = [
        {**cause, "variant": "", "log_evidence": 48.6, "rms": residual, "step": 1}
        for cause in causes
    ] + [
        {
            "cause": cause,
            "variant": "encoder on the link" if cause == "backlash" else "",
            "where": [names[0]],
            "log_evidence": 47.0 - 9.0 * row,
            "probability": 0.4 * 0.1**row if causes else None,
            "rms": residual * (1.1 + 0.6 * row),
            "parameters": {"size": {"value": 0.02, "unit": "rad"}},
            "step": 1,
        }
        for row, cause in enumerate(others)
    ]
    before, after = rms(names[0], "nominal", ~fit), rms(names[0], "extended", ~fit)
    horizons = [
        {"horizon_s": ahead, "joint": joint, "before": scale * b, "after": scale * a,
         "low": 1 - 1.15 * a / b, "high": 1 - 0.85 * a / b, "learned": 0.4 * scale * b}
        for ahead, scale in ((0.01, 0.1), (0.1, 0.6), (0.5, 0.9), (None, 1.0))
        for joint, b, a in [("all", before, after)] + [
            (name, rms(name, "nominal", ~fit), rms(name, "extended", ~fit))
            for name in names
        ]
    ]  # fmt: skip
    promoted = verdict in ("named", "ambiguous")
    return {
        "schema": "gatjax.diagnosis/1",
        "verdict": verdict,
        "sentence": SENTENCES[verdict],
        "robot": "servo_pendulum",
        "files": {"fit": ["fit.parquet"], "held_out": ["held.parquet"]},
        "causes": causes,
        "candidates": candidates,
        "joints": [
            {
                "name": name,
                "noise": 0.0007,
                "nominal_rms": rms(name, "nominal", fit),
                "tolerance_rms": 0.8 * rms(name, "nominal", fit),
                "extended_rms": rms(name, "extended", fit),
                "beyond_tolerance": 0.64 if row == 0 and verdict != "none" else 0.02,
            }
            for row, name in enumerate(names)
        ],
        "unexplained": {
            "significant": verdict == "unknown",
            "share": 0.91 if verdict == "unknown" else 0.03,
            "where": [names[0]] if verdict == "unknown" else [],
            "depends_on": [
                {"variable": "time", "share": 0.62},
                {"variable": f"position of {names[0]}", "share": 0.08},
            ],
            "term": "0.98 sin(10.7 time) N m" if verdict == "unknown" else None,
            **({"law": "periodic torque (0.98 N m)"} if verdict == "unknown" else {}),
        },
        "gain": {
            "metric": "position rmse", "unit": "rad", "before": before, "after": after,
            "low": 1 - 1.15 * after / before, "high": 1 - 0.85 * after / before,
            "noise_floor": 0.0007, "learned_ceiling": 0.4 * before,
            "learned_share": 0.93, "promoted": promoted, "horizons": horizons,
        },
        "calibration": [
            {"parameter": parameter, "where": [name], "nominal": value,
             "fitted": value * (1 + change), "tolerance": 0.1 * value, "unit": unit}
            for name in names
            for parameter, value, change, unit in (
                ("gain", 20.0, 0.031, "N*m/rad"), ("damping", 0.5, -0.08, "N*m*s/rad"),
                ("mass", 0.62, 0.1, "kg"),
            )
        ],
        "next_experiment": {
            "motion": "slow_reversals",
            "separates": ["coulomb_friction", "stiction"],
            "why": "At walking pace both look alike; only creeping shows the peak.",
            "separation": 8.31,
            "command": "gatjax collect --motion slow_reversals --out slow.parquet",
        },
        "smallest_effects": [
            {"cause": cause, "where": [names[-1]], "value": value, "unit": unit,
             "parameter": parameter, "at_most": cause == "command_delay"}
            for cause, parameter, value, unit in (
                ("coulomb_friction", "torque", 0.11, "N*m"),
                ("command_delay", "delay", 0.003, "s"),
                ("backlash", "width", 0.005, "rad"),
                ("gain_error", "scale", 0.93, "1"),
                ("torque_limit", "limit", 8.97, "N*m"),
            )
        ],
        "not_expressible": ["command_delay: MJCF has no delay that MJX obeys"],
        "data_checks": [
            {"file": "fit.parquet", "level": "warning", "check": "gaps",
             "text": "fit.parquet: row 401, column 'time': 0.31 s after row 400"},
            {"file": "fit.parquet", "level": "info", "check": "rate",
             "text": "fit.parquet: column 'time': a row every 10 ms (100 Hz)"},
        ],
        "seconds": 14.2,
    }  # fmt: skip


def write_folder(folder, verdict, names=("servo",)):
    folder.mkdir(parents=True, exist_ok=True)
    columns = signals(verdict, names)
    parquet.write_table(pa.table(columns), folder / "signals.parquet")
    content = described(verdict, columns, names)
    (folder / "diagnosis.json").write_text(json.dumps(content))
    return folder


ORDER = [
    "Evidence: which causes were weighed",
    "Where: residual of every joint",
    "Joint servo",
    "What it is worth on held-out logs",
    "What is left",
    "Calibration",
    "Next experiment",
    "What these logs could have shown",
    "Data checks",
    "Files and how this was made",
]
PICTURES = [
    "Close-up, ",
    "The whole ",
    "Residual over time",
    "Hysteresis in slow motion",
    "Residual against position",
    "Residual against velocity",
    "Residual against load",
    "Response to the command: gain",
    "Response to the command: delay",
]


class Text(HTMLParser):
    """The words of a page, and whether every element is closed where it should."""

    EMPTY = frozenset({"meta", "br", "path", "use", "rect", "circle"})

    def __init__(self, page):
        super().__init__()
        self.words, self.open, self.wrong, self.titles = [], [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag in self.EMPTY:
            return
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "script"):
            self.words.append(data)
        if self.open and self.open[-1] == "h2":
            self.titles.append(data)

    @property
    def all(self):
        return " ".join(self.words)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A page for every verdict, as text."""
    root = tmp_path_factory.mktemp("diagnoses")
    return {
        verdict: write_report(write_folder(root / verdict, verdict)).read_text()
        for verdict in EFFECTS
    }


def edited(folder, **changes):
    """A page without signals, with keys of diagnosis.json changed or, if None, gone."""
    folder.mkdir(parents=True, exist_ok=True)
    content = described("named", signals("named", ("servo",)), ("servo",))
    content.update(changes)
    content = {key: value for key, value in content.items() if value is not None}
    (folder / "diagnosis.json").write_text(json.dumps(content))
    return write_report(folder).read_text()


@pytest.mark.parametrize("verdict", EFFECTS)
def test_page_has_every_part_in_order_and_needs_no_network(pages, verdict):
    page = pages[verdict]
    text = Text(page)
    assert text.titles == ORDER
    assert text.wrong == [] and text.open == []
    assert (
        re.findall(r"(?:src|href)=[\"'](?!#)|url\((?!#)|@import|https?://", page) == []
    )
    assert re.findall(r"\bnan\b|\binf\b|\bNone\b", text.all) == []
    heads = re.findall(r"<h3>(.*?)</h3>", page)
    assert [t for t in PICTURES if not any(h.startswith(t) for h in heads)] == []
    assert len(page) < 1_000_000


@pytest.mark.parametrize("verdict", EFFECTS)
def test_verdict_stands_on_top_in_words(pages, verdict):
    first = SENTENCES[verdict].partition("; ")[0]
    assert re.search(r"<h1>(.*?)</h1>", pages[verdict])[1] == first
    badge = {"none": "better", "named": "better"}.get(verdict, "unclear")
    assert f'class="badge {badge}"' in pages[verdict]


def test_every_axis_has_a_unit(pages):
    svgs = re.findall(r"<svg.*?</svg>", pages["named"], re.DOTALL)
    assert len(svgs) == 14
    units = ("degrees", ", s", "N m", "Hz", "ms", "rad per rad", "%", "simulated ahead")
    for svg in svgs:
        words = [word for word in Text(svg).words if word.strip()]
        labels = [w for w in words if w.endswith(units) or "degrees/s" in w]
        assert len(labels) == (1 if "servo" in words else 2), words


def test_numbers_are_those_of_the_file(tmp_path):
    text = Text(edited(tmp_path)).all
    for words in (
        "0.378 to 0.462 N m (90 %), probability 96 %",
        "leaves ",
        "encoder on the link",
        "0.62 kg",
        "+95 %",
        "slow_reversals: it separates coulomb friction from stiction",
        "8.31 noise units",
        "0.286° (0.005 rad)",
        "row 401, column 'time'",
        "14.2 s",
        "It explains 93 % of what a learned model takes away",
        "The extended model is the one to use from here on (world.json)",
    ):
        assert words in text, words
    gain = {"before": 0.02, "after": 0.015, "low": -0.1, "high": 0.4, "promoted": False}
    page = edited(tmp_path, gain=gain)
    text = Text(page).all
    assert "<td class=n>25 %</td>" in page and "\N{MINUS SIGN}10 to 40 %" in text
    assert "not one to use yet" in text and "1.15° before, 0.859° after" in text


def test_joints_that_got_worse_are_told(tmp_path):
    row = {"horizon_s": None, "before": 0.02, "after": 0.015, "low": 0.1, "high": 0.4}
    worse = row | {"joint": "elbow", "after": 0.03, "low": -0.8, "high": -0.1}
    rows = [row | {"joint": "all"}, row | {"joint": "hip"}, worse,
            worse | {"horizon_s": 0.5, "joint": "knee"}]  # fmt: skip
    page = edited(tmp_path, gain={"before": 0.02, "after": 0.015, "horizons": rows})
    assert "It predicts elbow worse than before." in Text(page).all


def test_a_cause_with_several_values_has_one_card(tmp_path):
    def at(joint, size):
        ends = {"value": size, "low": 0.9 * size, "high": 1.1 * size, "unit": "N*m"}
        return {
            "cause": "coulomb_friction", "variant": "", "where": [joint],
            "parameters": {"torque": ends}, "probability": 0.97, "equivalent": [],
            "borne_out": True, "log_evidence": 9.0,
        }  # fmt: skip

    page = edited(tmp_path, causes=[at("hip", 0.5), at("knee", 0.3), at("toe", 0.4)])
    (card,) = re.findall(r"<div style=.--mark: var\(--gat\).>.*?</div>", page)
    for text in ("at hip, knee, toe", "0.3 N m to 0.5 N m", "3 values", "97 %"):
        assert text in card


def test_what_was_weighed_is_told_of_its_own_step(tmp_path):
    def row(name, joints, **more):
        return {
            "cause": name, "variant": "", "where": joints, "parameters": {},
            "probability": 0.97, "equivalent": [], "log_evidence": 9.0, "rms": 0.01,
        } | more  # fmt: skip

    one, two = (row("coulomb_friction", [joint]) for joint in ("hip", "knee"))
    gap = row("backlash", ["toe"])
    weighed = [
        row("coulomb_friction", ["hip", "knee"], step=1),
        gap | {"step": 2},
        row("dead_band", ["toe"], step=2, probability=0.1, log_evidence=8.0),
        row("payload", ["hip"], step=3, probability=None),
    ]
    page = edited(tmp_path, causes=[one, two, gap], candidates=weighed)
    assert "nearly as good as backlash at toe" in page
    assert "Weighed besides, not named" in page and "Cause 3" not in page
    assert page.count("<td>named</td>") == 2 and "explains or changes too" in page


def test_sizes_that_show_are_told_in_their_direction(pages):
    text = Text(pages["named"]).all
    assert "below 0.93" in text and "below 8.97 N m" in text and "3 ms" in text


def test_captions_speak_of_what_is_there(pages):
    said = "The moment at which the extended model gains most"
    assert said in pages["named"] and said not in pages["none"]
    assert "the moment at which that gains most" in pages["none"]
    blank = Signals(np.zeros(2), np.zeros(2, int), np.zeros(2, bool), {})
    assert "Shaded" in trend(blank._replace(held=np.array([False, True])))
    assert "Shaded" not in trend(blank)


def test_the_share_of_calibration_is_told(tmp_path):
    words = "with the named causes alone, the error is 1.15°."
    gain = {"before": 0.03, "after": 0.015}
    assert words not in Text(edited(tmp_path, gain=gain)).all
    told = gain | {"without_calibration": 0.02}
    assert words in Text(edited(tmp_path, gain=told)).all


def test_runner_up_is_told_why_it_lost(pages):
    assert "cannot be told apart from command delay at servo" in pages["ambiguous"]
    assert "nearly as good as coulomb friction at servo" in pages["named"]
    assert pages["named"].count("<td>named</td>") == 1
    assert "1.15° (0.02 rad)" in pages["named"]
    assert "explains or changes too little to be a finding" in pages["none"]
    assert "Weighed, not named" in pages["none"]
    assert "leaves too much to be the explanation" in pages["unknown"]
    assert "0.98 sin(10.7 time) N m" in pages["unknown"]
    assert "It is at servo" in pages["unknown"]
    assert "periodic torque (0.98 N m)" in pages["unknown"]


def test_shares_are_of_what_tolerances_leave(pages):
    text = Text(pages["named"]).all
    assert "it is 3 % of the power that tolerances alone leave." in text
    assert "share of the power left after tolerances that is more than" in text
    assert "nominal residual's power" not in text


KEYS = sorted(described("named", signals("named", ("servo",)), ("servo",)))


@pytest.mark.parametrize("key", KEYS)
def test_page_lives_without_a_key(tmp_path, key):
    text = Text(edited(tmp_path, **{key: None}))
    assert text.wrong == [] and text.titles[0] == "This diagnosis is not complete"
    assert "signals.parquet is missing" in text.all


def test_page_tells_why_there_is_no_gain(tmp_path):
    held = edited(tmp_path, gain=None, files={"fit": ["a"], "held_out": ["b"]})
    assert "falls at the start" in Text(held).all
    assert "No held-out logs" in Text(edited(tmp_path, gain=None, files={})).all


def test_page_has_inertial_unit_and_feet_of_a_standing_robot(tmp_path):
    row = {"name": "gyro.x", "unit": "rad/s", "noise": 0.01, "nominal_rms": 0.05,
           "tolerance_rms": 0.04, "extended_rms": 0.011}  # fmt: skip
    text = Text(edited(tmp_path, signals=[row]))
    assert "gyro.x" in text.all and "0.05 rad/s" in text.all and text.wrong == []


def test_page_tells_every_joint_at_every_horizon_beside_the_learned_model(pages):
    page = pages["named"].split("What it is worth")[1].split("</section>")[0]
    rows = [
        re.findall(r"<td[^>]*>(.*?)</td>", row)
        for row in re.findall(r"<tr>(.*?)</tr>", page)
    ]
    told = [(ahead, joint) for ahead, joint, *_ in filter(None, rows)]
    horizons = ("0.01 s", "0.1 s", "0.5 s", "whole log")
    assert told[:4] == [(ahead, "all") for ahead in horizons]
    assert set(told[4:]) == {(ahead, "servo") for ahead in horizons}
    for _, _, before, _, learned, *_ in filter(None, rows):
        share = float(learned.rstrip("°")) / float(before.rstrip("°"))
        assert share == pytest.approx(0.4, rel=0.01)


def test_a_learned_model_that_is_worse_measures_nothing(tmp_path):
    row = {"horizon_s": None, "joint": "all", "before": 0.02, "after": 0.01,
           "low": 0.4, "high": 0.6}  # fmt: skip
    for learned, useful in ((0.015, True), (0.03, False)):
        rows = [row | {"learned": learned}]
        gain = {
            "before": 0.02,
            "after": 0.01,
            "horizons": rows,
            "learned_ceiling": learned,
        }
        page = edited(tmp_path, gain=gain).split("What it is worth")[1]
        legend = page.split('class="legend"')[1].split("</div>")[0]
        assert ("learned model" in legend) is useful
        assert ("worse than the nominal model" in page) is not useful


def test_page_has_the_command_of_the_next_motion(tmp_path):
    advice = {"motion": "chirp", "command": "gatjax collect --motion chirp --out c"}
    assert advice["command"] in Text(edited(tmp_path, next_experiment=advice)).all


def test_barest_folder_and_broken_ones(tmp_path):
    (tmp_path / "diagnosis.json").write_text('{"verdict": "unknown", "gain": null}')
    (tmp_path / "signals.parquet").write_text("no table")
    text = Text(write_report(tmp_path).read_text()).all
    assert "signals.parquet cannot be read" in text
    assert "something that no known cause explains" in text
    (tmp_path / "diagnosis.json").write_text("{")
    with pytest.raises(ValueError, match="not JSON"):
        write_report(tmp_path)
    (tmp_path / "diagnosis.json").unlink()
    with pytest.raises(FileNotFoundError, match="gatjax diagnose"):
        write_report(tmp_path)


def test_text_of_others_is_not_run(tmp_path):
    evil = "<script>alert(1)</script>"
    hostile = {"motion": evil, "why": evil, "separates": [evil, evil]}
    checks = [{"file": evil, "level": "info", "check": evil, "text": evil}]
    page = edited(
        tmp_path,
        robot=evil,
        sentence=evil,
        next_experiment=hostile,
        data_checks=checks,
        not_expressible=[evil],
        files={"fit": [evil], "held_out": [evil]},
        unexplained={"term": evil, "depends_on": [{"variable": evil, "share": 0.5}]},
        candidates=[{"cause": evil, "where": [evil], "variant": evil}],
        smallest_effects=[{"cause": evil, "where": [evil], "value": 1, "unit": evil}],
        calibration=[{"parameter": evil, "where": [evil], "unit": evil, "nominal": 1}],
        joints=[{"name": evil, "nominal_rms": 0.1}],
    )
    assert evil not in page


def test_robot_of_23_joints_stays_small_and_draws_the_named_joint(tmp_path):
    names = tuple(f"joint_{row}" for row in range(23))
    folder = write_folder(tmp_path, "named", names)
    page = write_report(folder).read_text()
    assert len(page) < 3_000_000 and "22 more joints" in page
    assert [t for t in Text(page).titles if t.startswith("Joint")] == ["Joint joint_0"]
    content = json.loads((folder / "diagnosis.json").read_text())
    content["causes"][0]["where"] = ["all"]
    content["joints"][7]["tolerance_rms"] = 1.0
    (folder / "diagnosis.json").write_text(json.dumps(content))
    titles = Text(write_report(folder).read_text()).titles
    drawn = [title for title in titles if title.startswith("Joint")]
    assert drawn == ["Joint joint_7", "Joint joint_0"]


def two_runs(angle, delay=0.0, gain=1.0):
    """Signals of two runs whose measured angle is a late copy of the command."""
    when = np.arange(0.0, 20.0, 0.01)
    command = np.concatenate([angle(when), angle(when + 7.0)])
    late = [angle(when - delay), angle(when + 7.0 - delay)]
    measured = gain * np.concatenate(late)
    run = np.repeat([0, 1], len(when))
    trace = Trace(command, measured, command, None, None)
    return Signals(np.tile(when, 2), run, run == 1, {"servo": trace}), trace


def test_response_finds_gain_and_delay():
    rates = np.linspace(0.4, 5.0, 24)

    def many(when):
        return 0.1 * np.sin(2 * np.pi * rates * when[:, None] + rates**2 * 9.0).sum(-1)

    found, trace = two_runs(many, delay=0.034, gain=0.8)
    answer = response(found, trace.command, trace.measured)
    assert len(answer.frequency) > 10
    np.testing.assert_allclose(answer.gain, 0.8, atol=0.03)
    np.testing.assert_allclose(answer.delay, 0.034, atol=0.003)
    still = response(found, 0.0 * trace.command, trace.measured)
    assert len(still.frequency) == 0


def test_signals_are_read_within_their_runs():
    found, trace = two_runs(lambda when: 0.3 * when)
    np.testing.assert_allclose(speed(found, trace.command), 0.3, atol=1e-9)
    bumped = trace.measured.copy()
    bumped[3000:3050] += 0.2
    rows = close_up(found, trace._replace(measured=bumped))
    assert set(range(3000, 3050)) <= set(rows.tolist())
    assert len(set(found.run[rows])) == 1 and 280 <= len(rows) <= 302
    place, height = thinned(np.arange(4000.0), np.where(np.arange(4000) == 780, 9.0, 0))
    assert len(place) <= 700 and height.max() == 9.0 and 780.0 in place


def test_binned_mean_and_spread():
    random = np.random.default_rng(2)
    variable = random.uniform(-1.0, 1.0, 4000)
    bins = binned(variable, 3.0 * variable + random.normal(0.0, 0.5, 4000))
    np.testing.assert_allclose(bins.mean, 3.0 * bins.centre, atol=0.12)
    np.testing.assert_allclose(bins.spread, 0.5, atol=0.08)
    assert binned(np.ones(100), variable[:100]) is None


def test_room_reads_files_only():
    code = "import sys, gatjax.report.diagnosis; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert loaded.isdisjoint({"jax", "mujoco", "gatjax.sim", "gatjax.diagnosis"})
