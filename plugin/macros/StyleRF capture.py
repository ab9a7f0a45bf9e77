"""Copy the volume's transfer function and shading from the active view to the active StyleRF filter."""

from paraview.simple import GetActiveSource

from svv.errors import BadInput
from svv.pv.client.capture import CAPTURED, capture

filter = GetActiveSource()
try:
    if filter is None or filter.SMProxy.GetXMLName() not in CAPTURED:
        raise BadInput("Select StyleRF Stylized View, Views or Train in the Pipeline Browser first.")
    capture(filter)
except BadInput as error:
    print(error)
