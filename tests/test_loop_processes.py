"""Work in processes side by side, and how it ends."""

import math
import multiprocessing
import os
import time
from concurrent.futures.process import BrokenProcessPool

import pytest

from gatjax.loop.processes import side_by_side


@pytest.fixture(autouse=True)
def nothing_is_left():
    before = set(multiprocessing.active_children())
    yield
    assert set(multiprocessing.active_children()) <= before


def test_all_items_are_worked_on():
    assert sorted(side_by_side(math.sqrt, [9.0, 4.0, 1.0], 2)) == [1.0, 2.0, 3.0]


def test_an_error_of_one_ends_the_others():
    with pytest.raises(ValueError, match="non-negative"):
        list(side_by_side(time.sleep, [600.0, -1.0], 2))


def test_who_stops_listening_ends_them_all():
    results = side_by_side(time.sleep, [600.0, 0.0], 2)
    next(results)
    results.close()


def test_a_process_that_the_system_kills_is_told():
    with pytest.raises(BrokenProcessPool):
        list(side_by_side(os._exit, [1], 2))
