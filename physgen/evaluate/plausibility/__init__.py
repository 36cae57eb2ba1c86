"""Is the motion of a clip physically possible? Judged from the paths of its objects, without truth."""
