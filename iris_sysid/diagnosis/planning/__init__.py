"""What to measure next: the change of the set-up that tells the names of a missing effect apart."""
