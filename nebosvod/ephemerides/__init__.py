"""Where on the sky an orbit is and how well that is known: any observer, any times, from its covariance alone."""
