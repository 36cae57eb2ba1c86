"""Scene file (text) -> frozen Scene, or every problem in it at once."""
