"""Real astrometry -> an orbit with a covariance one can trust.

    files -> Astrometry -> observers, weights (observation) -> start -> correction + rejection -> estimate -> answer

`sky` and `correction` are the lean core (arrays only: one trajectory and one pass over all observations an iteration);
`estimation` puts the converged orbit into the program's one estimator, with every uncertainty group; the other modules
say what came out.
"""
