"""Mutated input for every reader: whatever a file holds, a reader returns or raises an IrisError."""
