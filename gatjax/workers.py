"""Worker processes on the CPU, deaf to Ctrl-C, and gone with whoever began them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any

ALONE = {"JAX_PLATFORMS": "cpu", "OPENBLAS_NUM_THREADS": "1"}
"""Read when libraries are loaded, which is before a worker's first own line."""

ENDED = (
    "a worker process was killed, which mostly means that memory ran out: close other "
    "programs, or leave it fewer processors (taskset -c 0 before the command), and run "
    "it again"
)


class Workers:
    """Processes that serve many calls; they begin with the first one.

    They know modules only, not the script that runs, which needs no `__main__` guard.
    """

    def __init__(self, count: int, shares: Sequence[set[int]] = ()) -> None:
        """Begin nothing yet.

        Args:
            count: of processes.
            shares: processors of each (`gatjax.processors.shares`); any if left out.
        """
        self._count, self._shares = count, shares
        self._pool: ProcessPoolExecutor | None = None
        self._ours: set[BaseProcess] = set()

    def results(
        self, function: Callable, jobs: Sequence[tuple]
    ) -> Iterator[tuple[int, Any]]:
        """Begin to call a function of a module with each of some arguments.

        Returns:
            An iterator over the place among the jobs and what the function returned, as
            they get done. Whatever ends it early, Ctrl-C too, ends the processes; who
            does not begin to listen has to `close`.

        Raises:
            BrokenProcessPool: one line: a process ended, and what to do.
        """
        with self._closed_by_errors():
            return self._done(self._begun(function, jobs))

    def _done(self, left: dict[Future, int]) -> Iterator[tuple[int, Any]]:
        with self._closed_by_errors():
            while left:  # with a pause often enough for Ctrl-C to come through
                done, _ = wait(left, timeout=1.0, return_when=FIRST_COMPLETED)
                for future in done:
                    yield left.pop(future), future.result()

    @contextmanager
    def _closed_by_errors(self) -> Iterator[None]:
        try:
            yield
        except BrokenProcessPool as error:
            self.close()
            raise BrokenProcessPool(ENDED) from error
        except BaseException:
            self.close()
            raise

    def _begun(self, function: Callable, jobs: Sequence[tuple]) -> dict[Future, int]:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            free = context.SimpleQueue()
            for share in self._shares:
                free.put(share)
            begin = _begin, (free, bool(self._shares))
            self._pool = ProcessPoolExecutor(self._count, context, *begin)
            # Left to the end of the interpreter it would miss modules, and say so.
            weakref.finalize(self, self._pool.shutdown, wait=False)
        others = set(multiprocessing.active_children())
        try:
            with _environment(ALONE), _no_main():
                submit = self._pool.submit
                return {submit(function, *job): k for k, job in enumerate(jobs)}
        finally:  # a stop may come while they begin
            self._ours |= set(multiprocessing.active_children()) - others

    def close(self) -> None:
        """End the processes; what they are at is dropped."""
        if self._pool is None:
            return
        for process in self._ours:
            process.terminate()
        # One that ends while it tells something leaves a listener waiting for more:
        # no end is seen while this process could write, too, which it never does.
        results: Any = self._pool._result_queue
        results._writer.close()
        self._pool.shutdown(cancel_futures=True)  # joins them: who else did would race
        self._pool, self._ours = None, set()


@contextmanager
def _environment(wanted: dict[str, str]) -> Iterator[None]:
    """Set variables for processes that begin in the block."""
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _no_main() -> Iterator[None]:
    """Hide the script that runs: processes that begin would run it once more."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _begin(free: Any, shared: bool) -> None:
    """Begin a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if shared:
        os.sched_setaffinity(0, free.get())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
