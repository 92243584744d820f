"""The policy file of the fastest walk, and the commands that walk it again."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

from gatjax.report.facts import choose_policy
from gatjax.report.read import Run
from gatjax.report.tables import Summary
from gatjax.report.wording import escape


class Winner(NamedTuple):
    """What a reader needs to take the fastest walk elsewhere."""

    method: str  # in words
    policy: Path
    evaluate: str  # walks it again on the robot of the run; empty if no verb has it
    deploy: str  # lets a NAO walk it; empty if it fell when it was judged


def winner_of(run: Run, summary: Summary) -> Winner | None:
    """Find the policy of the method that is ranked first; None without one."""
    chosen = choose_policy(run, summary.ranked[0]) if summary.ranked else None
    if chosen is None:
        return None
    policy = run.folder / "policies" / f"{chosen.stem}.json"
    path, flags = shlex.quote(str(policy)), ""
    for key, usual in (("robot", None), ("body_seed", 0), ("rate_hz", 50.0)):
        value = run.config.get(key, usual)
        if value != usual:
            flags += f" --{key.replace('_', '-')} {value}"
    first, robot = summary.ranked[0], run.config.get("robot")  # it may be a user's own
    named = run.robot.get("name", robot)
    known = robot in (None, named, run.robot.get("address", named))
    return Winner(
        method=first.label,
        policy=policy,
        evaluate=f"gatjax evaluate --policies {path}{flags}" if known else "",
        deploy=f"gatjax deploy {path} --robot lola" if first.stands else "",
    )


def winner_note(run: Run, summary: Summary) -> str:
    """The file and the commands as a note of the page; nothing without a walk."""
    found = winner_of(run, summary)
    if found is None:
        return ""
    walks = [
        f"{how}: <code>{escape(command)}</code>"
        for how, command in (("Walk it again", found.evaluate),
                             ("On a NAO", found.deploy)) if command
    ]  # fmt: skip
    return (
        f"<p class=note>The policy from {escape(found.method)}: "
        f"<code>policies/{escape(found.policy.name)}</code>. {'. '.join(walks)}</p>"
    )


def winner_lines(run: Run, summary: Summary) -> list[str]:
    """The same for a terminal."""
    found = winner_of(run, summary)
    if found is None:
        return []
    lines = [f"policy {found.policy}, from {found.method}"]
    lines += [f"walk it again: {found.evaluate}"] if found.evaluate else []
    return lines + ([f"on a NAO: {found.deploy}"] if found.deploy else [])
