"""ParaView's side: filters, capture, live camera, launcher. Nothing below knows of it."""

from svv.pv.processes import start_processes_by_fork
from svv.pv.torch_loading import prefer_its_own_symbols

prefer_its_own_symbols()
start_processes_by_fork()
