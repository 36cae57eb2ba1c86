"""World + Trajectory + Percepts -> Frames, one at a time."""
