"""Scene files -> how far the simulation is from what is known: the scorecards."""
