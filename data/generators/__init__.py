"""Programs that write the bundled recordings; they share no code with the estimator, so that its answers can be held against theirs."""
