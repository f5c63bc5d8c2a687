"""Speed, beside that of peers."""
