"""Ctrl-C, or a polite kill, that is never lost.

Python raises KeyboardInterrupt wherever it happens to be; inside a destructor or a C
callback the exception is printed or dropped, and the program goes on. So the press is
remembered, and the next stage of the work stops.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDS = [signal.SIGINT, signal.SIGTERM]  # a person's, a cluster's

_pressed = threading.Event()


@contextmanager
def heeded() -> Iterator[None]:
    """Remember Ctrl-C and SIGTERM while the block runs.

    An error of the block may be all that is left of one: libraries that are being
    loaded make one of it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        _pressed.set()
        raise KeyboardInterrupt

    _pressed.clear()
    before = {number: signal.signal(number, handle) for number in ENDS}
    try:
        yield
    except Exception:
        check()
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _pressed.clear()


def check() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed and got lost."""
    if _pressed.is_set():
        raise KeyboardInterrupt
