"""Let the animation show the data's time again."""

from svv.pv.orbit import stop_orbit

stop_orbit()
