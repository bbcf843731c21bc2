"""What is asked of an estimator and what it answers: blocks, priors, whitening, factors, estimates."""
