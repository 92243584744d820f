"""The command line of gatjax."""

from __future__ import annotations

import os
import sys
import traceback

from gatjax.cli.arguments import parse

STOPPED, FAILED = 130, 1  # exit codes: Ctrl-C, an error


def main(arguments: list[str] | None = None) -> int:
    """Run one verb; an error is one line, with a traceback only with --debug.

    Returns:
        Exit code, 0 only on success.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    given = [word for word in given if word != "--debug"] or ["--help"]
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    try:
        chosen = parse(given)
        from gatjax.cli.verbs import act  # jax and mujoco load here, after --help

        act(chosen)
    except KeyboardInterrupt:
        print("gatjax: stopped; `gatjax run --resume` goes on", file=sys.stderr)
        return STOPPED
    except (ValueError, OSError, RuntimeError, ImportError) as error:
        if debug:
            traceback.print_exc()
        line = " ".join(str(error).split()) or type(error).__name__
        print(f"gatjax: {line}", file=sys.stderr)
        return FAILED
    return 0
