"""The commands of physgen."""
