"""The command line of gatjax."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from typing import Any

from gatjax import __version__
from gatjax.cli import threads  # noqa: F401 before numpy is loaded
from gatjax.cli.arguments import (
    BenchDiagnose,
    Collect,
    Deploy,
    Diagnose,
    Evaluate,
    Import,
    Run,
    Search,
    SimulateNao,
    View,
)
from gatjax.cli.interrupts import check, heeded
from gatjax.cli.parsing import parse
from gatjax.hardware.links import is_hardware

STOPPED, FAILED = 130, 1  # exit codes: Ctrl-C, an error
EXPECTED = (ValueError, OSError, RuntimeError, ImportError)  # their text is for users


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; an error is one line, with a traceback only with --debug.

    Returns:
        Exit code, 0 only on success.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [word for word in given if word != "--debug"] or ["--help"]
    if given[0] == "--version":
        print(f"gatjax {__version__}")
        return 0
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    chosen, before = None, set()
    try:
        chosen = parse(given)
        before = _runs(chosen)
        with heeded():
            _act(chosen)
    except KeyboardInterrupt:
        print(f"gatjax: stopped; {_kept(chosen, before)}", file=sys.stderr)
        return STOPPED
    except Exception as error:
        if debug:
            traceback.print_exc()
        print(f"gatjax: {_line(error)}", file=sys.stderr)
        return FAILED
    return 0


def _act(chosen: Any) -> None:
    """Load what a verb needs, after --help, and do it."""
    if isinstance(chosen, Import):
        from gatjax.cli.importing import bring  # large logs: no room for jax and mujoco

        bring(chosen)
        return
    from gatjax.cli.engine import heed_engine
    from gatjax.cli.verbs import act

    heed_engine()
    check()  # what was pressed while all that was loaded
    act(chosen)


def _line(error: Exception) -> str:
    """Say an error in one line."""
    line = " ".join(str(error).split()) or type(error).__name__
    ours = type(error).__name__ != "LinAlgError"  # a ValueError that nobody can mend
    if isinstance(error, EXPECTED) and ours:
        return line
    return (
        f"internal error: {type(error).__name__}: {line}; run again with --debug for "
        f"the traceback"
    )


def _runs(chosen: Any) -> set[Any]:
    """The run folders that are there where a verb begins one, or its diagnosis."""
    if isinstance(chosen, Diagnose):
        file = chosen.out / "diagnosis.json"
        return {file.stat().st_mtime_ns} if file.exists() else set()
    if not isinstance(chosen, Run) or chosen.resume:
        return set()
    return {file.parent for file in chosen.out.glob("*/environment.json")}


def _kept(chosen: Any, before: set[Any]) -> str:
    """Say what Ctrl-C left of a verb's work and how to go on.

    Args:
        chosen: the verb.
        before: `_runs` before it began.
    """
    if isinstance(chosen, Run) and (chosen.resume or _runs(chosen) > before):
        flag = "--out" if chosen.run is None else "--run"
        folder = shlex.quote(str(chosen.run or chosen.out))
        return f"`gatjax run --resume {flag} {folder}` goes on"
    if isinstance(chosen, Search | BenchDiagnose):
        return "the same command goes on"
    if isinstance(chosen, Deploy):
        return "with its --out the same command goes on"
    if isinstance(chosen, SimulateNao):
        return "the simulated NAO is gone"
    if isinstance(chosen, Collect | Evaluate | View) and is_hardware(chosen.robot):
        if isinstance(chosen, Collect) and chosen.motion is not None:
            return f"its frames are in {chosen.out.with_suffix('')}"
        return "the same command goes on after the walks that are there"
    if isinstance(chosen, Diagnose) and (before or _runs(chosen)):
        if _runs(chosen) - before:
            return f"{chosen.out} has the new diagnosis, all but its report"
        if not _runs(chosen):
            return f"the earlier diagnosis in {chosen.out} was being replaced"
        return f"{chosen.out} keeps the earlier diagnosis"
    return "nothing was kept"
