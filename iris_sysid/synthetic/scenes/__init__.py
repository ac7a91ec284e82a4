"""The phenomena that can be rendered: one file each."""
