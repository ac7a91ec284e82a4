"""Joint tracking of many bodies, or of bodies that touch."""
