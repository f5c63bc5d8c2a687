"""Hard cases that must stay numerically stable."""
