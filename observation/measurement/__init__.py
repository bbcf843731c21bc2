"""Exposures -> computed directions psi, their partials, and which of them can be made."""
