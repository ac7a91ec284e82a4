"""Many bodies, or bodies that touch: tracked together."""
