"""Model selection: which equation of the bank predicts a trajectory best."""
