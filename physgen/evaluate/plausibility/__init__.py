"""Plausibility of motion without ground truth: tracks, their segments of constant
acceleration, and questions about them.
"""
