"""Work on the CPU in processes side by side, where threads would share one Python."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

import jax

from gatjax.sim.backend import use_compile_cache


def side_by_side(
    function: Callable[[Any], Any], items: Sequence[Any], count: int
) -> Iterator[Any]:
    """Yield what a function of a module gives for items, as they get done.

    Whatever ends this early, Ctrl-C too, ends the processes.

    Args:
        function: with one argument that can be pickled.
        items: its arguments.
        count: processes.

    Raises:
        BrokenProcessPool: the system killed one, for want of memory most often.
    """
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(count, context, _begin) as pool:
        try:
            for future in as_completed([pool.submit(function, each) for each in items]):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            ours = set(multiprocessing.active_children()) - others
            for process in ours:
                process.terminate()
            for process in ours:
                process.join()
            raise


def _begin() -> None:
    """Leave Ctrl-C to the parent, and a GPU too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    jax.config.update("jax_platforms", "cpu")
    use_compile_cache()
