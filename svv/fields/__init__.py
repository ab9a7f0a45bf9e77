"""What a scene is made of, from a field along rays up to a scene that follows its volume."""
