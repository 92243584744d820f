"""Benchmarks compare two times of one run; absolute ones say little about a machine."""

import pytest


@pytest.fixture
def ratio(benchmark, capsys):
    """Note seconds per call beside a reference, in the JSON and on the terminal."""

    def note(name, mine, reference):
        benchmark.extra_info[name] = mine / reference
        with capsys.disabled():
            print(
                f"\n{name}: {mine / reference:.2f} ({mine:.3f} s / {reference:.3f} s)"
            )

    return note
