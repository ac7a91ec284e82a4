"""Find the effects that a model lacks: score tests, a stepwise search with refits, and limits on all other effects."""
