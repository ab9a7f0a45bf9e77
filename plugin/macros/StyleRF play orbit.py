"""Let Play and Save Animation orbit the scene of the active StyleRF image, while the data's time stands still."""

from svv.errors import BadInput
from svv.pv.client.orbit import play_orbit

try:
    play_orbit()
except BadInput as error:
    print(error)
