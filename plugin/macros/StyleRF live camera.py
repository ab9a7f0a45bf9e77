"""Let the StyleRF image follow the camera of the view that shows the volume, as the property Follow Camera does."""

from svv.errors import BadInput
from svv.pv.display.linked_camera import follow

try:
    follow()
except BadInput as error:
    print(error)
