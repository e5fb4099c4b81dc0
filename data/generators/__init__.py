"""Simulated machines, and programs that write the bundled recordings; they share no code with the estimator that is held against them."""
