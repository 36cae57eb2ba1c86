"""Measure the distance of the simulation from known facts: the scorecards."""
