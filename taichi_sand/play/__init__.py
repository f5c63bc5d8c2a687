"""The window: a simulation on the screen, to watch, to change and to reach into."""
