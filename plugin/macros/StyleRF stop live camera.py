"""Stop the StyleRF images from following a camera."""

from svv.pv.display.linked_camera import stop_following

stop_following()
