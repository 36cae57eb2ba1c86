"""Models for measures."""
