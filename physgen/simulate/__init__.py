"""World -> Trajectory."""
