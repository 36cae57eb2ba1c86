"""A clip -> what happens in it: events, and sentences that are made of nothing else."""
