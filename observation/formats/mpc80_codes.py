"""One-letter codes of the MPC 80-column format and the ADES names of the same things.

Star catalogues: https://www.minorplanetcenter.net/iau/info/CatalogueCodes.html; kinds of observation (note 2):
https://www.minorplanetcenter.net/iau/info/OpticalObs.html.
"""

CATALOGUES = {
    "a": "USNOA1", "b": "USNOSA1", "c": "USNOA2", "d": "USNOSA2", "e": "UCAC1", "f": "Tyc1", "g": "Tyc2",
    "h": "GSC1.0", "i": "GSC1.1", "j": "GSC1.2", "k": "GSC2.2", "l": "ACT", "m": "GSCACT", "n": "SDSS8",
    "o": "USNOB1", "p": "PPM", "q": "UCAC4", "r": "UCAC2", "s": "USNOB2", "t": "PPMXL", "u": "UCAC3", "v": "NOMAD",
    "w": "CMC14", "x": "Hip2", "y": "Hip1", "z": "GSC", "A": "AC", "B": "SAO1984", "C": "SAO", "D": "AGK3",
    "E": "FK4", "F": "ACRS", "G": "LickGas", "H": "Ida93", "I": "Perth70", "J": "COSMOS", "K": "Yale", "L": "2MASS",
    "M": "GSC2.3", "N": "SDSS7", "O": "SSTRC1", "P": "MPOSC3", "Q": "CMC15", "R": "SSTRC4", "S": "URAT1",
    "T": "URAT2", "U": "Gaia1", "V": "Gaia2", "W": "Gaia3", "X": "Gaia3E", "Y": "UCAC5", "Z": "ATLAS2", "0": "IHW",
    "1": "PS1_DR1", "2": "PS1_DR2", "3": "Gaia_Int", "4": "GZ", "5": "UBSC", "6": "Gaia_2016",
}  # fmt: skip

# "" says nothing of the detector; A: taken before 2000 in the B1950 frame, turned to J2000 by the MPC
MODES = {
    " ": "PHO", "P": "PHO", "A": "PHO", "e": "ENC", "C": "CCD", "c": "CCD", "B": "CMO", "T": "MER", "M": "MIC",
    "E": "OCC", "H": "PMT", "N": "NOR", "n": "VID", "S": "CCD", "V": "CCD",
}  # fmt: skip

DELETED = "Xx"
RADAR = "Rr"
OFFSET = "O"
SECOND_LINES = {"S": "s", "V": "v", "R": "r"}
HEADERS = ("COD", "CON", "OBS", "MEA", "TEL", "NET", "BND", "COM", "NUM", "ACK", "AC2", "STD", "TYP", "#")
