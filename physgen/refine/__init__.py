"""Frames -> frames that a video diffusion model retouched: soft shadows, reflections, and the objects as they
were.
"""
