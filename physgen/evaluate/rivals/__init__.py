"""World -> Trajectory in other people's engines, so that their figures stand beside ours; see `rivals.roster`."""
