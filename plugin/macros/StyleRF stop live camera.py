"""Stop the StyleRF images from following a camera."""

from svv.pv.follow import stop_following

stop_following()
