"""Run folder to report.html, one file that opens without a network."""

from __future__ import annotations

from pathlib import Path

from gatjax.report import explained, facts, pictures, sections
from gatjax.report.diagnosis import write_report
from gatjax.report.document import document
from gatjax.report.read import Run, read_run
from gatjax.report.tables import Summary, summarise
from gatjax.report.verdict import Verdict, judge
from gatjax.report.walks import Walk, choose, read_walk, read_walks, told
from gatjax.report.winner import winner_lines, winner_note
from gatjax.report.wording import escape
from gatjax.runs import write_whole

BADGES = {
    "better": "grounding beat no grounding in this run",
    "safer": "grounding fell less, not faster, in this run",
    "unclear": "no clear difference in this run",
    "not better": "grounding did not beat no grounding in this run",
    "no comparison": "nothing to compare",
    "no data": "no data yet",
}


def build_report(folder: Path) -> Path:
    """Write report.html into a run folder, and into its diagnosis; return its path.

    Whatever the run has not written yet is named on the page and left out. The file is
    replaced in one step, so an older report survives a full disk.

    Args:
        folder: Run folder as docs/files.md describes it; its tables hold SI units.

    Raises:
        FileNotFoundError: `folder` is not a folder.
        OSError: the page cannot be written; the old one is still there.
    """
    folder = Path(folder)
    run = read_run(folder)
    summary = summarise(run)
    found = read_walks(folder, run.problems).items()
    walks = {name: told(walk, run.rollouts) for name, walk in found}
    winner = summary.ranked[0].name if summary.ranked else None
    page = render(run, summary, judge(summary), choose(walks, winner))
    if run.diagnosis:
        write_report(folder / "diagnosis")
    path = folder / "report.html"
    write_whole({path: page.encode("utf-8")})
    return path


def headline(folder: Path) -> str:
    """What came out of a run, in one sentence: that on top of its report."""
    return judge(summarise(read_run(Path(folder)))).sentence


def onward(folder: Path) -> list[str]:
    """Lines with the policy of the fastest walk and the commands that walk it."""
    run = read_run(Path(folder))
    return winner_lines(run, summarise(run))


def render(run: Run, summary: Summary, verdict: Verdict, walks: list[Walk]) -> str:
    """Put the page of a run together."""
    robot = escape(run.robot.get("name", "unknown robot"))
    body = "".join(
        (
            head(run, summary, verdict, robot),
            missing(run.problems),
            sections.method_table(summary, winner_note(run, summary)),
            sections.animation(walks),
            pictures.robot_pictures(summary),
            pictures.cost_pictures(run, summary),
            pictures.prediction_pictures(run),
            explained.explained_section(run, summary),
            facts.parameter_table(run, summary),
            facts.run_facts(run),
            "<footer>Written by gatjax from the files of the run folder.</footer>",
        )
    )
    return document(run.folder.resolve().name, body)


def build_walk_page(walk: Path, out: Path, fell: bool = False) -> None:
    """Write the animation of one walk file (walks/*.npz) as a page of its own."""
    shown = read_walk(walk)._replace(fell=fell)
    page = document(shown.label, sections.animation([shown]))
    write_whole({Path(out): page.encode("utf-8")})


def head(run: Run, summary: Summary, verdict: Verdict, robot: str) -> str:
    """Run name, the verdict and the key numbers."""
    kind = verdict.kind.replace(" ", "-")
    name = escape(run.folder.resolve().name)
    first, found, rest = verdict.sentence.partition("; ")
    second = (
        f'<p class="also">{escape(rest[:1].upper() + rest[1:])}</p>' if found else ""
    )
    return (
        f'<header><p class="name">gatjax report of {name}, robot: {robot}</p>'
        f"<h1>{escape(first)}</h1>{second}"
        f'<p><span class="badge {kind}">{BADGES[verdict.kind]}</span></p>'
        f"{sections.cards(summary)}</header>"
    )


def missing(problems: list[str]) -> str:
    """Say what the run folder lacks; nothing if it is complete."""
    if not problems:
        return ""
    lines = "".join(f"<li>{escape(problem)}</li>" for problem in problems[:12])
    if len(problems) > 12:
        lines += f"<li>and {len(problems) - 12} more</li>"
    return (
        '<section class="missing"><h2>This run is not complete</h2>'
        f"<ul>{lines}</ul></section>"
    )
