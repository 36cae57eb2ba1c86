"""Photo -> Percepts and an editable scene file: one role after the other, each with swappable backends."""
