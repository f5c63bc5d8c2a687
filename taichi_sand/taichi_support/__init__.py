"""What works around Taichi 1.7: starting it, access from Python, quick tracing, fields that are used again."""
