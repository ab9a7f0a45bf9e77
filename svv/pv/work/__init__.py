"""The work of filters: base classes, what panels ask for, and scenes, views and images as ParaView has them."""
