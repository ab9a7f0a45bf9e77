"""ParaView's side: filters, capture, live camera, launcher. Nothing below knows of it."""

from svv.pv.own_symbols import prefer_own_symbols

prefer_own_symbols()
