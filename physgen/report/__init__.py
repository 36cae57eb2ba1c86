"""Frames and results -> files: the video, the run record, the page."""
