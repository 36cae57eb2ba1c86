"""How well right is told from wrong: clips that are known to be either, from two sources, and what the judge says."""
