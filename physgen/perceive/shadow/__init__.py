"""Shadow stage of physgen."""
