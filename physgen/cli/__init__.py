"""Cli stage of physgen."""
