"""ParaView's side: filters, capture, live camera, launcher. Nothing below knows of it."""

from svv.pv.own_symbols import prefer_own_symbols
from svv.pv.processes import start_processes_by_fork

prefer_own_symbols()
start_processes_by_fork()
