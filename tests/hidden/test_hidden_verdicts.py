"""The generator hides an effect; the diagnosis has to find it, and nothing else."""

import json

import pytest

from gatjax.data.recording import read_recording
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.start import Start
from gatjax.surrogate.hidden import write_cases

# Seeds are the first ones, counted from 1, whose effects have a visibility of 3 or
# more: that is where the diagnosis promises to name them. Backlash, which takes
# longest, is what test_docs_notebook hides.
CASES = {
    "one_of_two": (
        1,
        "arm_two",
        {"mix": {"single": 1.0}, "causes": ["viscous_friction"]},
    ),
    "null": (1, "arm_servo", {"mix": {"null": 1.0}}),
    "outside": (1, "arm_servo", {"mix": {"outside": 1.0}}),
}


@pytest.fixture(scope="module", params=CASES)
def answered(request, tmp_path_factory):
    """A hidden case with its truth and the diagnosis of it."""
    folder = tmp_path_factory.mktemp(request.param)
    seed, robot, wanted = CASES[request.param]
    write_cases(folder, 1, seed, robots=[robot], **wanted)
    truth = json.loads((folder / "answers.json").read_text())["cases"][0]
    case = folder / "cases" / truth["id"]
    told = diagnose(
        Start(str(folder / "models" / f"{truth['robot']}.xml")),
        Logs(
            [read_recording(file) for file in sorted(case.glob("fit*.parquet"))],
            [read_recording(case / "held.parquet")],
        ),
        folder / "out", 0, lambda stage, share: None,
    )  # fmt: skip
    return truth, told, folder / "out"


def test_the_verdict_is_true(answered):
    truth, told, _ = answered
    assert told["verdict"] == truth["verdict"]
    found = {tuple(row["where"]): row["cause"] for row in told["causes"]}
    hidden = {tuple(cause["where"]): cause["cause"] for cause in truth["causes"]}
    if truth["verdict"] != "unknown":
        assert len(told["causes"]) == len(truth["causes"])
        assert found.keys() == hidden.keys()
        for where, name in found.items():
            assert name in truth["accepted"][hidden[where]]


def test_the_size_is_near_the_truth(answered):
    truth, told, _ = answered
    if truth["verdict"] != "named":
        pytest.skip("only a named cause has a size")
    for cause in truth["causes"]:
        found = next(r for r in told["causes"] if r["where"] == cause["where"])
        value = found["parameters"][cause["main_parameter"]]
        true = cause["parameters"][cause["main_parameter"]]["value"]
        assert value["value"] == pytest.approx(true, rel=0.25)
        assert value["low"] < true < value["high"]


def test_what_it_writes_is_whole_and_the_extension_predicts_better(answered):
    truth, told, out = answered
    written = json.loads((out / "diagnosis.json").read_text())
    assert written["verdict"] == told["verdict"]
    for name in ("world.json", "extended.xml", "signals.parquet"):
        assert (out / name).stat().st_size > 0
    assert (told["fallback"] is not None) == told["unexplained"]["significant"]
    gain = told["gain"]
    if truth["verdict"] == "named":
        share = 1.0 - gain["after"] / gain["before"]
        assert share > 0.5 * truth["oracle"]["gain"]
        assert gain["noise_floor"] < gain["after"]
        if (alone := gain["without_calibration"]) is not None:
            assert alone < gain["before"]
    else:
        assert told["causes"] or gain["without_calibration"] is None
        assert gain["after"] < 1.5 * gain["before"]
