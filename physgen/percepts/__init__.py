"""The maps of a photo, in memory and as a folder of pictures that can be opened and painted."""
