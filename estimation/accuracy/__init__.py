"""What an estimate is worth: budgets, bounds, worst correlations, ellipses, consistency, score tests."""
