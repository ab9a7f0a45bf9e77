"""Play and Save Animation go round the scene of the active StyleRF image; the data's time stands still meanwhile."""

from svv.errors import BadInput
from svv.pv.orbit import play_orbit

try:
    play_orbit()
except BadInput as error:
    print(error)
