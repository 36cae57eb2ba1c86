"""Retouch frames by a video diffusion model: soft shadows, reflections, unchanged
objects.
"""
