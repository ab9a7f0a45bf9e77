"""How our programs end: what went wrong becomes one sentence on standard error and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import NoReturn

from svv.errors import BadInput, Cancelled


def end_with(run: Callable[[], object], name: str) -> NoReturn:
    """Do the work of a program, then end it.

    Args:
        run: The work; what it returns is the exit code, where that is a number.
        name: Of the program, before its sentence.

    Exit codes: 0 done, 2 bad use or bad input, 130 stopped by the user.
    """
    try:
        done = run()
    except BadInput as error:
        _fail(name, str(error))
    except (Cancelled, KeyboardInterrupt):
        _fail(name, "stopped; to go on, give the same command again.", 130)
    except MemoryError:
        _fail(name, "There is not enough memory; take a smaller size or the preset draft.")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader of our output has left
        sys.exit(0)
    except OSError as error:
        about = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        _fail(name, f"{about}{error.strerror or error}.")
    sys.exit(done if isinstance(done, int) else 0)


def _fail(name: str, message: str, code: int = 2) -> NoReturn:
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(code)
