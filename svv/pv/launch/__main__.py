"""Entry point of an installation's launcher, for any Python: ``python3 -m svv.pv.launch pvpython script.py``."""

from __future__ import annotations

import sys
from typing import NoReturn

from svv.errors import BadInput
from svv.pv.launch.programs import PROGRAMS, run


def main() -> NoReturn:
    """Start the program that the command line names, by default ``paraview``, with the remaining arguments.

    A single ``--prepare`` prepares the environment instead.
    """
    program, arguments = "paraview", sys.argv[1:]
    if arguments and arguments[0] in PROGRAMS:
        program, *arguments = arguments
    try:
        if program == "paraview" and arguments == ["--prepare"]:
            from svv.pv.launch.prepare import prepare

            print(prepare())
            sys.exit(0)
        run(program, arguments)
    except BadInput as error:
        print(f"svv: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
