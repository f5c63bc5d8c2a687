"""Scenes held to the numbers that they must show."""
