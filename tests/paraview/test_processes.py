"""Python's processes and locks inside ParaView, whose ``sys.executable`` is not a Python interpreter."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CHOSEN = "import multiprocessing; print('CHOSEN', multiprocessing.get_start_method(allow_none=True))"


def test_numba_gets_its_lock_and_processes_end(pvpython) -> None:
    done = pvpython(
        "import multiprocessing, sys, warnings\n"
        "warnings.simplefilter('error')\n"
        "import numba.np.ufunc.parallel\n"
        "process = multiprocessing.Process(target=sys.exit, args=(3,))\n"
        "process.start()\n"
        "process.join(600)\n"
        "print('ENDED', process.exitcode)\n",
        own=True,
    )
    assert "ENDED 3" in done.stdout, done.stdout + done.stderr
    assert "NumbaSystemWarning" not in done.stderr


def test_what_was_chosen_before_stays(pvpython) -> None:
    done = pvpython(
        "import sys\n"
        "for name in [name for name in sys.modules if name.split('.')[0] == 'svv']:\n"
        "    del sys.modules[name]\n"
        "import multiprocessing\n"
        "multiprocessing.set_start_method('spawn', force=True)\n"
        f"import svv.pv\n{CHOSEN}",
        own=True,
    )
    assert "CHOSEN spawn" in done.stdout


def test_outside_of_paraview_nothing_is_chosen() -> None:
    command = [sys.executable, "-c", f"import svv.pv\n{CHOSEN}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "CHOSEN None" in done.stdout
