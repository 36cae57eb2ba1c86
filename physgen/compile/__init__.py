"""Compile a scene and its masks into a World for the engine, and warn of doubtful
values.
"""
