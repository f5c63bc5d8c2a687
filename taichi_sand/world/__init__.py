"""The state of a simulation, and who is near whom."""
