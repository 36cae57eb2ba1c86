"""Where an object keeps light away: from the floor it stands over, from an upright wall behind, from a table.

Simple geometry under one distant light of some width and an even ambient one. A surface that gets the share d of its
light directly, of which v is blocked, and of whose sky the part a is hidden, keeps (1 - d v) (1 - (1 - d) a) of it.
Logarithms of such shares add up over objects.
"""
