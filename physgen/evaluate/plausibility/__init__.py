"""Is the motion in a clip physically possible? Tracks in, scores with their reasons out; no truth needed."""
