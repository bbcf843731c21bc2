"""The element names of ADES (IAU Astrometry Data Exchange Standard, versions 2017 and 2022), and one near to another.

https://minorplanetcenter.net/iau/info/ADES.html; names as in the official adesmaster.xml.
"""

import difflib

VERSIONS = ("2017", "2022")
NAMES = frozenset((
    "permID", "provID", "artSat", "trkSub", "obsID", "obsSubID", "trkID", "trkMPC", "mode", "stn", "sys", "ctr",
    "pos1", "pos2", "pos3", "vel1", "vel2", "vel3", "posCov11", "posCov12", "posCov13", "posCov22", "posCov23",
    "posCov33", "prog", "obsTime", "rmsTime", "ra", "dec", "raStar", "decStar", "obsCenter", "deltaRA", "deltaDec",
    "dist", "pa", "rmsRA", "rmsDec", "rmsDist", "rmsPA", "rmsCorr", "astCat", "mag", "rmsMag", "band", "fltr",
    "photCat", "photAp", "nucMag", "logSNR", "shapeOcc", "seeing", "exp", "rmsFit", "nStars", "ref", "disc", "subFrm",
    "subFmt", "precTime", "precRA", "precDec", "uncTime", "notes", "remarks", "deprecated", "localUse", "trx", "rcv",
    "delay", "rmsDelay", "doppler", "rmsDoppler", "com", "frq", "orbProd", "orbID", "resRA", "resDec", "selAst",
    "sigRA", "sigDec", "sigCorr", "sigTime", "biasRA", "biasDec", "biasTime", "photProd", "resMag", "selPhot",
    "sigMag", "biasMag", "photMod", "resDelay", "selDelay", "sigDelay", "resDoppler", "selDoppler", "sigDoppler",
))  # fmt: skip
OLD_VERSION = "2017"
RECORDS = ("optical", "offset", "occultation", "radar")
BY_LOWER_CASE = {name.lower(): name for name in NAMES}


def about_version(file: str, version: str) -> tuple[str, ...]:
    """What a user should know about the version a file states, "" if it states none."""
    if version == OLD_VERSION:
        return (f"{file} is ADES {version}: its names mean the same in 2022, the version now in use",)
    return () if version else (f'{file} does not say its version ("# version=2022")',)


def suggestion(name: str) -> str:
    """What to do about a name that is not one of ADES."""
    exact = BY_LOWER_CASE.get(name.lower())
    near = [exact] if exact else difflib.get_close_matches(name, sorted(NAMES), 1, 0.6)
    return f'did you mean "{near[0]}"?' if near else "delete it, or see the list of ADES names in docs/fit.md"
