"""Methods side by side, scene by scene, on one page with their scores."""
