"""Make a figure of the active scene, with a legend, as the active view sees it; its panel saves it."""

from svv.errors import BadInput
from svv.pv.filters.figures import add_figure

try:
    add_figure()
except BadInput as error:
    print(error)
