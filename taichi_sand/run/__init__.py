"""The simulation: its loop, what it reads, keeps and follows."""
