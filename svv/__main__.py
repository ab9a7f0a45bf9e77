"""Run the ``svv`` command as ``python -m svv``."""

from svv.cli.app import main

if __name__ == "__main__":
    main()
