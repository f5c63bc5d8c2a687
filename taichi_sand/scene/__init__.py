"""WHAT to simulate: the scene file and its keys, the shapes of grains, where they start. Knows no Taichi."""
