"""Other ways to draw frames, one file each; the only place under `render` where torch is imported."""
