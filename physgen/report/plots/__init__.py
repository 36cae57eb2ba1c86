"""World and trajectory -> figures for papers, by matplotlib: energy, paths, contacts, and strips of frames."""
