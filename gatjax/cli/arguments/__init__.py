"""What each verb of the command line takes: one frozen dataclass a verb."""

from __future__ import annotations

from gatjax.cli.arguments.logs import BenchDiagnose, Diagnose, Import
from gatjax.cli.arguments.robots import Collect, Deploy, Evaluate, SimulateNao, View
from gatjax.cli.arguments.search import Bench, Doctor, Ground, Report, Run, Search, Work

ABOUT = (
    "Ground a robot simulator in logs of the robot, search for a better walk in it, "
    "and show whether the walk transfers. Start with: gatjax run. "
    "Every verb also takes --debug (tracebacks); gatjax --version prints the version."
)

VERBS: dict[str, type] = {
    "run": Run,
    "collect": Collect,
    "import": Import,
    "diagnose": Diagnose,
    "ground": Ground,
    "search": Search,
    "work": Work,
    "evaluate": Evaluate,
    "view": View,
    "deploy": Deploy,
    "nao": SimulateNao,
    "report": Report,
    "bench": Bench,
    "doctor": Doctor,
}

__all__ = [
    "ABOUT",
    "VERBS",
    "Bench",
    "BenchDiagnose",
    "Collect",
    "Deploy",
    "Diagnose",
    "Doctor",
    "Evaluate",
    "Ground",
    "Import",
    "Report",
    "Run",
    "Search",
    "SimulateNao",
    "View",
    "Work",
]
