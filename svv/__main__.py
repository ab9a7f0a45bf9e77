"""``python -m svv`` is the ``svv`` command."""

from svv.cli.app import main

if __name__ == "__main__":
    main()
