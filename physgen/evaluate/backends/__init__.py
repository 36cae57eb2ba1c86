"""What turns pictures into features, and two frames into flow; one file each."""
