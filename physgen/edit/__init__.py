"""The editor: a scene file and a person in a browser -> the file as that person means it. See docs/editing.md."""
