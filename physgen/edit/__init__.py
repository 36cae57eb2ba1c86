"""The editor of scene files in the browser; see docs/editor.md."""
