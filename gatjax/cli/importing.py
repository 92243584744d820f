"""`gatjax import`: logs as people have them, into one recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from gatjax.cli.arguments import Import
from gatjax.cli.inputs import make_folder
from gatjax.data import checks, readers
from gatjax.data.mapping import ColumnMap, column_map, read_map
from gatjax.data.recording import Recording, check_ending, write_recording
from gatjax.report.recording import draw_recording
from gatjax.runs import write_whole


def bring(verb: Import) -> None:
    """Read logs, put them on one clock, write and show the recording."""
    if not verb.logs:
        raise ValueError("no log is named; give at least one file or folder")
    check_ending(verb.out)
    sources = [readers.read(path) for path in verb.logs]
    for source in sources:
        runs = len(source.runs)
        print(f"{source.name}: {source.kind}, {runs} run{'s' * (runs > 1)}, signals:")
        for name, stream in source.runs[0].items():
            print(f"  {name}: {_said(stream)}")
    if verb.draft is not None:
        tree = {"columns": _merged(sources), "drop": [], "metadata": {}}
        text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
        write_whole({verb.draft: text.encode("utf-8")})
        print(f"{verb.draft}: a draft of the map; correct it and give it as --map")
    given = None if verb.map is None else read_map(verb.map)
    made = [readers.assemble(source, given or _drafted(source)) for source in sources]
    recording = joined([each.recording for each in made], str(verb.out))
    for each in made:
        for note in each.notes:
            print(f"note: {note}")
    make_folder(verb.out.parent)
    write_recording(verb.out, recording)
    for row in checks.summary([(recording, checks.findings(recording, {}, "held-out"))]):
        print(f"{row['level']}: {row['text']}")
    picture = verb.out.with_suffix(".png")
    draw_recording(recording, picture)
    rows, ids = len(recording.time), len(np.unique(recording.trajectory))
    print(f"{verb.out}: {rows} rows, {ids} trajectories; picture {picture}")


def joined(parts: list[Recording], name: str) -> Recording:
    """Recordings one after the other, each run with a number of its own."""
    shared = set.intersection(*(set(each.columns) for each in parts))
    ids, first = [], 0
    for each in parts:
        _, index = np.unique(each.trajectory, return_inverse=True)
        ids.append(index + first)
        first += int(index.max()) + 1
    return Recording(
        name=name,
        time=np.concatenate([each.time for each in parts]),
        trajectory=np.concatenate(ids),
        columns={
            column: np.concatenate([each.columns[column] for each in parts])
            for column in sorted(shared)
        },
        metadata=parts[0].metadata,
    )


def _drafted(source: readers.Source) -> ColumnMap:
    """The map that the format itself suggests."""
    return column_map({"columns": source.draft}, f"the draft for {source.kind}")


def _merged(sources: list[readers.Source]) -> dict:
    """The drafts of all sources."""
    out: dict = {}
    for source in sources:
        out |= source.draft
    return out


def _said(stream) -> str:
    """Rate and range of a signal."""
    steps = np.diff(stream.time)
    rate = 1.0 / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else 0.0
    low, high = np.nanmin(stream.values), np.nanmax(stream.values)
    return f"{len(stream.time)} samples, {rate:.4g} per unit of time, {low:.4g} to {high:.4g}"
