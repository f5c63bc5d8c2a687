"""Files: how all that is written is written, and how what strangers may have made is read. Knows no Taichi, and nothing of sand."""
