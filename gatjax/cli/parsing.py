"""The command line, read into the dataclasses of `arguments`."""

from __future__ import annotations

import dataclasses
import difflib
from typing import Annotated, Any

import tyro

from gatjax.cli.arguments import ABOUT, VERBS, BenchDiagnose, Run
from gatjax.cli.refusals import short
from gatjax.settings import DEMO, PRESETS, LoopSettings, SearchSettings


def _preset(arguments: list[str]) -> str:
    """Find the preset on the command line; it sets the defaults of all the rest."""
    for index, word in enumerate(arguments):
        name, _, value = word.partition("=")
        if name == "--preset":
            return value or "".join(arguments[index + 1 : index + 2])
    return "demo"


def _typed(arguments: list[str]) -> tuple[str, ...]:
    """Name the settings of a run that the command line gives, defaults left out."""
    flags = {word.partition("=")[0].replace("-", "_") for word in arguments}
    flags |= {flag.replace("__no_", "__", 1) for flag in flags}
    names = [setting.name for setting in dataclasses.fields(LoopSettings)]
    names += [setting.name for setting in dataclasses.fields(SearchSettings)]
    return tuple(name for name in ("preset", *names) if f"__{name}" in flags)


def _check_lists(arguments: list[str]) -> None:
    """Refuse a flag for several things that comes twice: only the last would count."""
    kinds = [*VERBS.values(), BenchDiagnose, LoopSettings]
    several = {
        f"--{field.name.replace('_', '-')}"
        for kind in kinds
        for field in dataclasses.fields(kind)
        if str(field.type).startswith("tuple[")
    }
    given = [word.partition("=")[0].replace("_", "-") for word in arguments]
    for flag in given:
        if flag in several and given.count(flag) > 1:
            raise ValueError(f"{flag} comes twice; give all of it after one {flag}")


def parse(arguments: list[str]) -> Any:
    """Read the command line into the verb's dataclass.

    Raises:
        ValueError: no such verb or option, a value that is none, or a flag that takes
            several files is given twice.
    """
    _check_lists(arguments)
    if arguments[:2] == ["bench", "diagnose"]:
        with short("bench diagnose"):
            prog = "gatjax bench diagnose"
            return tyro.cli(BenchDiagnose, args=arguments[2:], prog=prog)
    _check_verb(arguments[0])
    preset = _preset(arguments)
    run = Run(loop=PRESETS.get(preset, DEMO), typed=_typed(arguments))
    verbs: Any = None
    for name, kind in VERBS.items():
        default = run if kind is Run else tyro.MISSING_NONPROP
        verb = Annotated[kind, tyro.conf.subcommand(name, default=default)]
        verbs = verb if verbs is None else verbs | verb
    with short(arguments[0]):
        return tyro.cli(verbs, args=arguments, prog="gatjax", description=ABOUT)


def _check_verb(word: str) -> None:
    """Refuse a verb that is none, with the one that may be meant."""
    if word in VERBS or word.startswith(("-h", "--help", "--tyro-")):
        return
    near = difflib.get_close_matches(word, VERBS, 1)
    there = f"did you mean {near[0]}? There" if near else "there"
    raise ValueError(f"{word!r} is no verb; {there} are {', '.join(VERBS)}")
