"""The ParaView side. Beside this file: what all of it shares, such as values of panels, failures, observers."""

from svv.own_symbols import TORCH, prefer_own_symbols
from svv.pv.launch.processes import start_processes_by_fork

prefer_own_symbols(TORCH)
start_processes_by_fork()


def strict(on: bool = True) -> None:
    """Let errors of StyleRF filters end the script that runs them, unless it catches them, or (False) not.

    In pvpython and pvbatch, what updates a filter then raises :class:`svv.errors.BadInput` with the filter's sentence
    if it fails, and saving what a failed or empty filter shows does, too. Without it, a filter that fails only prints
    its sentence, as ParaView's own do. ``svv pvpython`` and ``svv pvbatch`` start with it on. In ParaView's window it
    does nothing. Example::

        svv.pv.strict()
        try:
            painted.UpdatePipeline()
        except svv.BadInput as error:
            print(error)  # StyleRF Stylized View: There is no style picture brush.jpg: ...
    """
    from svv.pv.client.strict import be_strict

    be_strict(on)
