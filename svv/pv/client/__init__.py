"""What runs in ParaView's client: observers, the linked camera, the mouse, clicks, the orbit.

Nothing here is imported by a filter on a server.
"""
