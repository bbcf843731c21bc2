"""Bytes of files of astrometry -> records, and back; nothing is weighed or computed here."""
