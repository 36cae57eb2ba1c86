"""How often `physgen evaluate plausibility` calls right clips right and wrong ones wrong."""
