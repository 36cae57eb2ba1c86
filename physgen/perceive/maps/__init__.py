"""Maps stage of physgen."""
