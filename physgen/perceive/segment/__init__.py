"""Segment stage of physgen."""
