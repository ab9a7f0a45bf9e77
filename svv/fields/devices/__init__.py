"""Which device is used: the choice, and the check of a GPU on its first use, every kernel against plain torch."""
