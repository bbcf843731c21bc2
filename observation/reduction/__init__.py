"""Records -> what a fit needs of them: observers, weights, corrections of star catalogues."""
