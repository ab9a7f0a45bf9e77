"""Run the ``svv`` command as ``python -m svv``."""

from svv.cli.app import program

if __name__ == "__main__":
    program()
