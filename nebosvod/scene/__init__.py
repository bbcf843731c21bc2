"""What a mission means: forces, the reference orbit, priors, telescopes, exposures planned or recorded."""
