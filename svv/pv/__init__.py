"""ParaView's side: filters, capture, live camera, launcher. Nothing below knows of it."""

from svv.pv.torch_loading import prefer_its_own_symbols

prefer_its_own_symbols()
