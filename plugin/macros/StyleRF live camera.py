"""The view that shows the volume moves the StyleRF image beside it, as the property Follow Camera does."""

from svv.errors import BadInput
from svv.pv.follow import follow

try:
    follow()
except BadInput as error:
    print(error)
