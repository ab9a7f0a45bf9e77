"""What runs in ParaView's client: capture of a display, the follower of cameras, clicks, masks, the orbit.

The filters that they serve run in ParaView's server: :mod:`svv.pv.filters`.
"""
