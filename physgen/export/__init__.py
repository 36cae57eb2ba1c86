"""Write the ground truth of frames and trajectories in the formats of other tools, one
file per format.
"""
