"""How a view shows: what becomes of a display's properties, the volume as shown, the linked camera and its mouse."""
