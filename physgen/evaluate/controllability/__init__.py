"""Pushes of one object, of many directions and sizes -> how its motion answers to them: the paper's figure 6."""
