"""A scene at another time step of its volume, or with other opacities: what is learned and painted goes along."""
