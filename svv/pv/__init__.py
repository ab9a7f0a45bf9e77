"""The ParaView side: filters, capture, live camera, launcher. No lower layer imports it."""

from svv.own_symbols import TORCH, prefer_own_symbols
from svv.pv.launch.processes import start_processes_by_fork

prefer_own_symbols(TORCH)
start_processes_by_fork()
