"""Read a scene file into a frozen Scene, or report all of its problems at once."""
