"""Perception: a photo becomes percepts and an editable scene file; each role has swappable backends."""
