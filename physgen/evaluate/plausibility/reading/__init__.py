"""What somebody hands in -> tracks: one file a format."""
