"""Frames and trajectory -> ground truth in the formats that other tools read, one file a format."""
