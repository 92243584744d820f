"""The task of runs whose files are tested: these do not hang on how long walks are."""

from gatjax.task import Task

SHORT = Task(duration=2.0)
