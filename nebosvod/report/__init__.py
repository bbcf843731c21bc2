"""The accuracy report: a run folder in, one self-contained HTML page out."""
