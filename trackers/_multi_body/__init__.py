"""Several bodies followed at once, also where they touch."""
