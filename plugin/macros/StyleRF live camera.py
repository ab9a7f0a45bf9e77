"""The active view's camera moves the StyleRF image beside it: small while the mouse drags, sharp on release."""

from svv.errors import BadInput
from svv.pv.follow import follow

try:
    follow()
except BadInput as error:
    print(error)
