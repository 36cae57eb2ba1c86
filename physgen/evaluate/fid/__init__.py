"""Clips of several methods beside clips of a reference -> how far apart their frames and their motion are."""
