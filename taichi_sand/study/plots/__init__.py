"""Pictures of what `run` has written: series, force distribution, fabric, profiles."""
