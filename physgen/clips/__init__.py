"""Videos and pictures on disk -> frames and coverage, decoded when they are asked for."""
