"""The editor's server: HTTP on this machine alone -> doors of one Session."""
