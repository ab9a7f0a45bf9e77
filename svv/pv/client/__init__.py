"""What runs in ParaView's client: observers, the linked camera, the mouse, clicks, the orbit.

The filters that they serve run in ParaView's server: :mod:`svv.pv.filters`.
"""
