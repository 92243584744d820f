"""Diagnosis folder to report.html, one file that opens without a network."""

from __future__ import annotations

from pathlib import Path

from gatjax.report.diagnosis import candidates, evidence, gain, joints, tables
from gatjax.report.diagnosis.read import Diagnosis, read_diagnosis
from gatjax.report.document import document
from gatjax.report.wording import escape
from gatjax.runs import write_whole


def write_report(folder: Path) -> Path:
    """Writes report.html into a diagnosis folder and returns its path.

    What the folder lacks is named on the page and left out; only diagnosis.json must be
    there. The file is replaced in one step.

    Args:
        folder: holds diagnosis.json and signals.parquet, as docs/files.md says; SI.

    Raises:
        FileNotFoundError: no diagnosis.json.
        ValueError: diagnosis.json is no JSON object.
        OSError: the page cannot be written; the old one is still there.
    """
    folder = Path(folder)
    diagnosis = read_diagnosis(folder)
    path = folder / "report.html"
    name = f"diagnosis of {diagnosis.raw.get('robot') or folder.resolve().name}"
    page = document(name, render(diagnosis))
    write_whole({path: page.encode("utf-8")})
    return path


def render(diagnosis: Diagnosis) -> str:
    """Puts the page of a diagnosis together."""
    return "".join(
        (
            evidence.head(diagnosis),
            _missing(diagnosis.problems),
            candidates.candidate_table(diagnosis),
            evidence.location(diagnosis),
            joints.joint_sections(diagnosis),
            gain.gain_section(diagnosis),
            tables.unexplained(diagnosis),
            tables.calibration(diagnosis),
            tables.next_experiment(diagnosis),
            tables.smallest_effects(diagnosis),
            tables.data_checks(diagnosis),
            tables.made_of(diagnosis),
            "<footer>Written by gatjax from the files of the folder.</footer>",
        )
    )


def _missing(problems: list[str]) -> str:
    """What the folder lacks; nothing if it is complete."""
    if not problems:
        return ""
    lines = "".join(f"<li>{escape(problem)}</li>" for problem in problems)
    return (
        '<section class="missing"><h2>This diagnosis is not complete</h2>'
        f"<ul>{lines}</ul></section>"
    )
