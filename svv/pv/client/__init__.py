"""What runs in ParaView's client: capture of a display, the follower of cameras, clicks, masks, the orbit."""
