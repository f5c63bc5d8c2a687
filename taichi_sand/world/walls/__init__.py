"""Walls: segments, joints, motion, walls with force."""
