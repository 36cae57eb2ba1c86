"""What a stage made, kept by the content of all that it was made of."""
