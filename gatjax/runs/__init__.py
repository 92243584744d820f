"""The run folder: what a run leaves behind, and how another run goes on from it.

The files and their columns are in `docs/files.md`. A file is either written whole or
not at all (`write_whole`), so a kill at any moment leaves a folder that can be read and
resumed.
"""

from gatjax.files import make_folder, read_json, write_json, write_whole
from gatjax.runs.folder import (
    RunFolder,
    check_run,
    check_same,
    digest,
    latest_run,
    open_run,
    resume_run,
)
from gatjax.runs.held import held
from gatjax.runs.progress import Progress
from gatjax.runs.tables import add_rows, read_table
from gatjax.walk.policy import read_policy, write_policy

__all__ = [
    "Progress",
    "RunFolder",
    "add_rows",
    "check_run",
    "check_same",
    "digest",
    "held",
    "latest_run",
    "make_folder",
    "open_run",
    "read_json",
    "read_policy",
    "read_table",
    "resume_run",
    "write_json",
    "write_policy",
    "write_whole",
]
