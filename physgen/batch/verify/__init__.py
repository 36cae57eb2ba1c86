"""Clips on disk -> what is made of their scenes now, compared: the first sample, object and frame that differ.

`told` reads what a run left, `motion` and `pictures` compare, `causes` looks for why, `again` does it all for a clip,
`verdict` holds what was found and says it in a line.
"""
