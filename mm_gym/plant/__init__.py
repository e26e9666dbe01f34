"""The plant: the simplest model that covers a scene, compiled to plain arrays."""
