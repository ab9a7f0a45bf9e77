"""How the programs end: an error becomes one sentence on standard error and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import NoReturn

from svv.errors import BadInput, Cancelled, Elsewhere


def end_with(run: Callable[[], object], name: str) -> NoReturn:
    """Run a program's work, then exit.

    Args:
        run: The work. If it returns an integer, that is the exit code.
        name: Name of the program, printed before an error message.

    Exit codes: 0 success, 2 bad usage or bad input, 130 stopped by the user.
    """
    try:
        done = run()
    except BadInput as error:
        _fail(name, str(error))
    except (Cancelled, KeyboardInterrupt):
        _fail(name, "stopped; run the same command again to resume.", 130)
    except Elsewhere as error:
        sys.exit(error.code)
    except MemoryError:
        _fail(name, "There is not enough memory; choose a smaller size or the preset draft.")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader of the output has gone
        sys.exit(0)
    except OSError as error:
        about = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        _fail(name, f"{about}{error.strerror or error}.")
    sys.exit(done if isinstance(done, int) else 0)


def _fail(name: str, message: str, code: int = 2) -> NoReturn:
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(code)
