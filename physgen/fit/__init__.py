"""From filmed motion back to physics: tracks, estimates with intervals, and a report."""
