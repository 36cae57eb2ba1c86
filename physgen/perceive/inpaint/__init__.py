"""Inpaint stage of physgen."""
