"""Live: scenes are learned beside the window, and filters show the best there is until they are done."""
