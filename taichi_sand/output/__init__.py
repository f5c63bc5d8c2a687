"""Films and pictures as files."""
