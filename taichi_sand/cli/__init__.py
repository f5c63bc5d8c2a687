"""The command `taichi-sand`."""
