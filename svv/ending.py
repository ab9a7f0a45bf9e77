"""How the programs end: an error becomes one sentence on standard error and an exit code."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import NoReturn

from svv.errors import BadInput, Cancelled, Elsewhere, is_lack_of_memory

NO_MEMORY = "There is not enough memory; choose a smaller size or the preset draft."
"""What is said where memory runs out."""

NO_ADDRESSES = (
    "The libraries do not fit into the address space: raise its limit (ulimit -v), or limit the memory with a control "
    "group instead."
)
"""What is said where libraries cannot be loaded; PyTorch's with CUDA reserve several gigabytes."""

NOT_MAPPED = ("failed to map segment", "cannot allocate memory")
"""What errors of importing contain if the address space does not suffice."""


def end_with(run: Callable[[], object], name: str) -> NoReturn:
    """Run a program's work, then exit with 0, its integer, 2 (bad input, said after ``name``) or 130 (stopped)."""
    _stop_on_terminate()
    try:
        done = run()
    except BadInput as error:
        _fail(name, str(error))
    except (Cancelled, KeyboardInterrupt):
        _fail(name, "stopped; run the same command again to resume.", 130)
    except Elsewhere as error:
        sys.exit(error.code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader of the output has gone
        sys.exit(0)
    except OSError as error:
        _fail(name, describe_os_error(error))
    except ImportError as error:
        if not any(said in str(error).lower() for said in NOT_MAPPED):
            raise
        _fail(name, NO_ADDRESSES)
    except (MemoryError, RuntimeError) as error:
        if not is_lack_of_memory(error):
            raise
        _fail(name, NO_MEMORY)
    sys.exit(done if isinstance(done, int) else 0)


def leave(code: int) -> NoReturn:
    """End the process with this exit code after what is to be done at its end, but without taking everything down.

    That would call the destructors of hundreds of thousands of objects and of the libraries of torch, for .1 to .5 s
    and 100 MB more than the work itself took.
    """
    alone = all(thread.daemon or thread is threading.main_thread() for thread in threading.enumerate())
    if alone:
        atexit._run_exitfuncs()
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except OSError:  # Python has its own way to end if nobody reads the output
            alone = False
    if alone:
        os._exit(code)
    sys.exit(code)


def describe_os_error(error: OSError) -> str:
    """Return one sentence about an error of the system, with the file that it concerns if that is known."""
    about = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
    return f"{about}{error.strerror or error}."


def _stop_on_terminate() -> None:
    """Let SIGTERM, by which systems and schedulers end programs, stop the work as Ctrl-C does."""
    main = threading.current_thread() is threading.main_thread()
    if main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def _fail(name: str, message: str, code: int = 2) -> NoReturn:
    print(f"{name}: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(code)
