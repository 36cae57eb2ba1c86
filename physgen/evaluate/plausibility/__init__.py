"""Plausibility of motion without a truth: tracks, their stretches of constant acceleration, and questions to them."""
