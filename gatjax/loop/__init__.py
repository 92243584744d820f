"""Grounded simulation learning from logs to a walk, for any robot."""

from gatjax.loop.beginning import ungrounded
from gatjax.loop.candidates import Candidate, Job
from gatjax.loop.ground import (
    ground,
    helpful,
    learn_grounding,
    predictions,
    stable,
    write_grounded,
)
from gatjax.loop.optimise import optimise
from gatjax.loop.robots import Simulator
from gatjax.loop.setting import Robot, Setting, resolved, total_work
from gatjax.loop.stages import COMPARED, run, run_all
from gatjax.runs import Progress

__all__ = [
    "COMPARED",
    "Candidate",
    "Job",
    "Progress",
    "Robot",
    "Setting",
    "Simulator",
    "ground",
    "helpful",
    "learn_grounding",
    "optimise",
    "predictions",
    "resolved",
    "run",
    "run_all",
    "stable",
    "total_work",
    "ungrounded",
    "write_grounded",
]
