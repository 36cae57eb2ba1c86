"""Objects of known mass, and orders of friction and elasticity -> how well somebody tells them; in names, px and
g.
"""
