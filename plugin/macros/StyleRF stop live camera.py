"""The StyleRF images stand still again."""

from svv.pv.follow import stop_following

stop_following()
