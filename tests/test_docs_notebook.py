import json
import pathlib
import re

import jupytext
import nbclient
import pytest
from nbclient.exceptions import CellExecutionError
from nbformat.v4 import new_code_cell

NOTEBOOKS = pathlib.Path(__file__).parents[1] / "notebooks"
TOUR, DIAGNOSIS = NOTEBOOKS / "tour.py", NOTEBOOKS / "diagnosis.py"
FEWER = "from gatjax.loop import evaluate; evaluate.CONFIRMATIONS = 3"  # not 10 walks


def executed(notebook, folder):
    client = nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(folder)}}
    )
    return client.execute()


def printed(notebook):
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.get("name") == "stdout")


@pytest.fixture
def folder(tmp_path, monkeypatch, pytestconfig):
    cache = pytestconfig.rootpath / ".pytest_cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))  # gatjax keeps compiled code there
    return tmp_path


def test_tour_runs_where_there_is_no_run(folder):
    tour = jupytext.read(TOUR)
    tour.cells.insert(0, new_code_cell(FEWER))
    tour = executed(tour, folder)
    text = printed(tour)
    pictures = [
        output
        for cell in tour.cells
        for output in cell.get("outputs", [])
        if "image/png" in output.get("data", {})
    ]
    assert len(pictures) == 2
    assert (folder / "runs").is_dir()
    assert re.search(r"theta0 in the simulator: \d\d\.\d cm/s, 0 of 20 fell", text)
    assert re.search(r"error after 0.5 s, all joints: -\d+ %", text)
    assert "com_offset" in text and "gat_0_1_mean" in text


def test_diagnosis_names_what_was_hidden(folder):
    notebook = executed(jupytext.read(DIAGNOSIS), folder)
    text = printed(notebook)
    cells = [cell for cell in notebook.cells for _ in cell.get("outputs", [])]
    assert len(cells) >= 8
    assert "named - The simulation lacks backlash" in text
    assert "backlash ['servo']" in text.splitlines()[-1]
    assert (folder / "found" / "report.html").is_file()
    told = json.loads((folder / "found" / "diagnosis.json").read_text())
    truth = json.loads((folder / "hidden" / "answers.json").read_text())["cases"][0]
    width, true = (each["causes"][0]["parameters"]["width"] for each in (told, truth))
    assert width["value"] == pytest.approx(true["value"], rel=0.25)
    assert width["low"] < true["value"] < width["high"]
    gain = told["gain"]
    share = 1.0 - gain["after"] / gain["before"]
    assert share > 0.5 * truth["oracle"]["gain"]
    assert gain["noise_floor"] < gain["after"]


def test_a_failing_cell_fails(folder):
    tour = jupytext.read(TOUR)
    tour.cells = [cell for cell in tour.cells if cell.cell_type == "code"][:1]
    tour.cells[0].source = "raise ValueError('planted')"
    with pytest.raises(CellExecutionError, match="planted"):
        executed(tour, folder)
