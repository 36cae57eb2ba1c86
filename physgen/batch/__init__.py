"""Many scenes -> many output folders."""
