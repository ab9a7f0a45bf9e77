"""Add the array by which the active volume is coloured as a layer of a scene, with its transfer function."""

from svv.errors import BadInput
from svv.pv.client.layers import add_layer

try:
    add_layer()
except BadInput as error:
    print(error)
