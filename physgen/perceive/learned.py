"""The network of the offline stages: what it sees in a photo, and masks that follow from it."""
