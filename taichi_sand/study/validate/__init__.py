"""Reference cases with known answers."""
