"""The window: a face of a session."""
