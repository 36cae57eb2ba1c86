"""Models that measures ask."""
