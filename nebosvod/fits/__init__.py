"""Real astrometry -> an orbit with a covariance one can trust.

    files -> Astrometry -> observers, weights (observation) -> start -> correction + rejection -> estimate -> answer

`correction` is the lean core (arrays only: one trajectory and one pass over all observations an iteration); `general`
puts the converged orbit into the program's one estimator, with every uncertainty group; the others say what came out.
"""
