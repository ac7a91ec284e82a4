"""Models of the user's own: from an equation in text, or from a plain function."""
