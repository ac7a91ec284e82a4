"""Find the effect that a model lacks: score tests, a stepwise search, refits, and what the data exclude."""
