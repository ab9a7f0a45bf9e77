"""The time of each stage of training and rendering, compared with the best that the machine could do."""
