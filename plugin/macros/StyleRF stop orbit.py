"""Let the animation show the data's time again."""

from svv.pv.client.orbit import stop_orbit

stop_orbit()
