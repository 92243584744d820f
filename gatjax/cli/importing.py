"""`gatjax import`: logs as people have them, into one recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from gatjax.cli.arguments import Import
from gatjax.cli.progress import shown
from gatjax.data import checks, readers
from gatjax.data.mapping import JOINT_FAMILIES, ColumnMap, is_dropped, read_map
from gatjax.data.readers import drafts
from gatjax.data.recording import (
    Recording,
    check_ending,
    check_output,
    check_recording,
    write_recording,
)
from gatjax.data.spill import release
from gatjax.report.recording import draw_recording
from gatjax.runs import Progress, make_folder, write_whole

LOOKED_AT = 100_000  # rows; checks of longer recordings take their time and memory
RESTS, FEW = 0.05, 20  # share of samples at an end that is told; values beside it
WHOLE = 4  # logs of which every signal is listed
PAIR = ("command", "position")  # what every joint has to have
OFTEN = 10.0  # s between lines of progress in a log


def bring(verb: Import) -> None:
    """Read logs, put each on one clock, write and show the recording.

    Raises:
        ValueError: one line with what is wrong and where.
        FileNotFoundError: a log or the map is not there.
    """
    if not verb.logs:
        raise ValueError("no log is named; give at least one file or folder")
    _check_spared(verb)
    check_output(verb.out)
    given = None if verb.map is None else read_map(verb.map)
    make_folder(verb.out.parent)
    recording = _read(verb, given)
    _tell_missing(recording)
    told = [column.partition(".") for column in recording.columns]
    joints = list(dict.fromkeys(j for kind, _, j in told if kind in PAIR))
    check_recording(_called_as(recording, verb.logs), joints)
    write_recording(verb.out, recording)
    _judge(recording, joints)
    picture = verb.out.with_suffix(".png")
    draw_recording(recording, picture)
    rows, runs = len(recording.time), len(np.unique(recording.trajectory))
    print(
        f"recording  {verb.out}: {rows} rows, {runs} run{'s' * (runs > 1)}, "
        f"joints {', '.join(joints)}"
    )
    print(f"picture    {picture}")


def _check_spared(verb: Import) -> None:
    """Refuse an output that would replace a log, a file of one, or the map."""
    beside = [".png"]
    beside += [".json"] if check_ending(verb.out) == ".csv" else []
    beside += [".map.yaml"] if verb.map is None else []
    written = {verb.out, *(verb.out.with_suffix(ending) for ending in beside)}
    taken = {path.resolve() for path in written}
    for file in [*verb.logs, *([verb.map] if verb.map else [])]:
        if file.resolve() in taken:
            raise ValueError(f"{file} would be written over; choose another --out")
        if file.is_dir():
            inside = [w for w in taken if w.exists() and file.resolve() in w.parents]
            if inside:
                raise ValueError(
                    f"{inside[0]} is a file of {file} and would be written over; "
                    f"choose another --out"
                )


def _read(verb: Import, given: ColumnMap | None) -> Recording:
    """The recording that the logs make; what is not in it is forgotten."""
    rows = _rows_of(given)
    with shown(float(len(verb.logs))) as progress:
        sources = [
            readers.read(path, _teller(progress, path), rows) for path in verb.logs
        ]
    scale = (
        None
        if given is None or "time" not in given.entries
        else (given.entries["time"].factor * given.entries["time"].slope)
    )
    for number, source in enumerate(sources):
        _say(source)
        if number < WHOLE:
            _list(source, drafts.seconds(source) if scale is None else scale)
    if given is None:
        _write_draft(verb.out.with_suffix(".map.yaml"), sources)
    try:
        made = [readers.assemble(each, given) for each in sources]
    except ValueError as error:
        if given is not None:
            raise
        draft = verb.out.with_suffix(".map.yaml")
        raise ValueError(f"{error}; the draft is {draft}") from error
    for note in dict.fromkeys(note for each in made for note in each.notes):
        print(f"note: {note}")
    parts = [each.recording for each in made]
    recording = readers.joined(parts, str(verb.out))
    every = {column for each in parts for column in each.columns}
    partly = sorted(every - set(recording.columns))
    if partly:
        print(f"note: left out, not in every log: {', '.join(partly)}")
    facts = {key for each in parts for key in each.metadata}
    differ = sorted(facts - set(recording.metadata))
    if differ:
        print(
            f"note: metadata that differs between the logs is left out: "
            f"{', '.join(differ)}"
        )
    return recording


def _called_as(recording: Recording, logs: tuple[Path, ...]) -> Recording:
    """The recording by the names of its logs, for it is not written yet."""
    return recording._replace(name=f"{', '.join(map(str, logs))}, as imported")


def _rows_of(given: ColumnMap | None) -> readers.Given:
    """Columns of time and runs that a map names otherwise than a recording does."""
    entries = {} if given is None else given.entries
    named = {name: entries[name].source for name in ("time", "trajectory")
             if name in entries and entries[name].source != name}  # fmt: skip
    skips = partial(is_dropped, given) if given is not None else readers.Given().skips
    return readers.Given(named.get("time"), named.get("trajectory"), skips)


def _teller(progress: Progress, path: Path) -> Callable[[float], None]:
    """Tells how much of a log is read."""
    progress.stage(f"read {path.name}")
    state = {"told": 0.0, "time": time.monotonic()}

    def tell(share: float) -> None:
        progress.work(share - state["told"])
        state["told"] = share
        if time.monotonic() - state["time"] > OFTEN:
            state["time"] = time.monotonic()
            progress.stage(f"read {path.name}")

    return tell


def _say(source: readers.Source) -> None:
    """Print what a log is."""
    count, signals = len(source.runs), len(source.runs[0])
    print(
        f"{source.name}: {source.kind}, {count} run{'s' * (count > 1)}, "
        f"{signals} signal{'s' * (signals > 1)}"
    )


def _list(source: readers.Source, scale: float) -> None:
    """Print the signals of a log's first run; `scale` is s per unit of its time."""
    run = source.runs[0]
    width = max(len(name) for name in run)
    for name, stream in run.items():
        print(f"  {name:<{width}}  {_facts(stream, scale)}")
        release(*stream)


def _facts(stream: readers.Stream, scale: float) -> str:
    """Rate, gaps, range and resolution of a signal; `scale` is s per unit of time."""
    usual = stream.period()
    rate = f"{1.0 / (scale * usual):.4g} Hz" if usual > 0.0 else "no rate"
    gaps = int(np.sum(np.diff(stream.time) > 2.5 * usual)) if usual > 0.0 else 0
    finite = stream.values[np.isfinite(stream.values)]
    if not len(finite):
        return f"{len(stream.time)} samples, none of them a number"
    apart = np.diff(np.unique(np.round(finite[:LOOKED_AT], 9)))
    least = f", steps of {apart.min():.3g} or more" if len(apart) else ", constant"
    said = f"{len(stream.time)} samples, {rate}"
    said += f", {gaps} gap{'s' * (gaps > 1)}" if gaps else ""
    low, high = finite.min(), finite.max()
    rest = [f", {share:.0%} at its {name}" for name, share in (
        ("least", np.mean(finite == low)), ("largest", np.mean(finite == high)),
    ) if share > RESTS and len(apart) > FEW]  # fmt: skip
    return f"{said}, {low:.4g} to {high:.4g}{least}{''.join(rest)}"


def _tell_missing(recording: Recording) -> None:
    """Print what the logs do not have, of what a recording may."""
    families = {column.partition(".")[0] for column in recording.columns}
    missing = [name for name in (*JOINT_FAMILIES, "gyro") if name not in families]
    if missing:
        print(f"not there: {', '.join(missing)}")


def _write_draft(path: Path, sources: list[readers.Source]) -> None:
    """Write the draft of a map, unless there is one that somebody corrected."""
    if path.is_file() and drafts.is_corrected(path.read_text("utf-8", "replace")):
        print(
            f"map        {path} was corrected and stays; it was not used: give it as "
            f"--map for that, or remove it for a draft of these logs"
        )
        return
    write_whole({path: drafts.text(sources).encode("utf-8")})
    print(
        f"map        {path}: a draft; correct names, units, signs and give it as --map"
    )


def _judge(recording: Recording, joints: list[str]) -> None:
    """Print what a diagnosis would say of the recording."""
    free = dict.fromkeys(joints, (-np.inf, np.inf))
    if len(recording.time) > LOOKED_AT:
        recording = _begun(recording)
        print(f"note: looked over are the first {LOOKED_AT} rows")
    found = checks.findings(recording, free, "fit")
    for row in checks.summary([(recording, found)]):
        level = "no diagnosis" if row["level"] == "refuse" else row["level"]
        print(f"{level}: {row['text']}")


def _begun(recording: Recording) -> Recording:
    """The first rows of a recording."""
    return recording._replace(
        time=recording.time[:LOOKED_AT],
        trajectory=recording.trajectory[:LOOKED_AT],
        columns={name: v[:LOOKED_AT] for name, v in recording.columns.items()},
    )
