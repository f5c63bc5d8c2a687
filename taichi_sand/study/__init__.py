"""What accuracy costs, measured."""
