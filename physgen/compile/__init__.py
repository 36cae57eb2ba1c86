"""Scene + masks -> World: everything resolved that the engine needs, and the lints on the way."""
