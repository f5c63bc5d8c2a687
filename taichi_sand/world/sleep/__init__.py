"""Grains that are not computed: who falls asleep, who wakes."""
