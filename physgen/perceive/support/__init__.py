"""Support stage of physgen."""
