"""Orbit files of others, a few lines each, with their source."""

import json
from pathlib import Path
from typing import Any

import pytest

SHARED = Path(__file__).resolve().parents[3].parent / "shared"
# ESA NEOCC, 2024YR4.ke0 (neo.ssa.esa.int, 2025), without its comments and COR lines
YR4 = """format  = 'OEF2.0'       ! file format
rectype = 'ML'           ! record type (1L/ML)
refsys  = ECLM J2000     ! default reference system
END_OF_HEADER
2024YR4
 KEP   2.5163069044136290E+00  6.6159975981023389E-01   3.4082582480218 271.3674684214714 134.3645021052249  1.6920818963896668E+01
 MJD     60704.950998578 TDT
 MAG  24.047  0.150
 LSP   0  0    6
 COV   6.769968240272774E-11  9.646957745952683E-12  3.457473365420079E-11
 COV  -3.151438509698589E-13 -3.346513343938389E-11 -7.110469433965839E-10
 COV   1.374769350085458E-12  4.929612697176532E-12 -7.075387272258082E-15
 COV  -4.832006078219451E-12 -1.013217615721232E-10  1.862233070913929E-11
 COV   5.111244507367507E-12 -2.224187343052052E-11 -3.633630291446235E-10
 COV   5.969973454335258E-11 -5.388998905894120E-11 -8.122657616521732E-13
 COV   7.681517948700098E-11  3.539236068331752E-10  7.468582398398277E-09
"""  # noqa: E501
# OrbFit, 1862.fel (Fenu24/OrbFit, b972250), without comments
APOLLO = """format  = 'OEF2.0'       ! file format
rectype = 'ML'           ! record type (1L/ML)
refsys  = ECLM J2000     ! default reference system
END_OF_HEADER
1862
 EQU   1.4701327303133416E+00  -0.347997673402040   0.438628665083009    0.032422437795482    0.045038613504679 174.9957100982316
 MJD     54668.051354402 TDT
 MAG  16.060  0.090
 LSP   0  0    6
 COV   7.287488579757116E-19  1.686847120926070E-17  4.010003600843116E-18
 COV  -1.180745444928167E-17  8.034574250593214E-18  8.860870718733954E-16
 COV   5.140037446298903E-16  1.238530013875658E-16 -9.916891740900795E-17
 COV   2.675559917693260E-16  3.266490580970769E-14  3.299574582102208E-17
 COV  -3.335611661976569E-18  8.481046945841306E-17  7.713625988235384E-15
 COV   8.901625625028793E-16  3.923122570352937E-16  1.452881253301630E-15
 COV   5.344943058008415E-16  1.603306701672967E-14  2.296362358658831E-12
 NOR   1.553324637576804E+20 -1.624745069554624E+19  8.297507776954657E+18
 NOR  -8.478748807862707E+16  3.080008658405875E+17  1.412078862118941E+17
 NOR   2.894427737277158E+18 -1.302288351856251E+18  3.218790994917962E+17
 NOR  -3.951726081490713E+17 -2.797294211060531E+16  1.016879589558650E+18
 NOR  -9.061685505392694E+16  9.288757264609963E+16  1.131588222839142E+16
 NOR   8.572016948283608E+16 -1.006014018262263E+17 -3.593347983846824E+15
 NOR   1.221344239785517E+17  4.401236108070472E+15  2.773865133483840E+14
"""  # noqa: E501


@pytest.fixture
def yr4(tmp_path: Path) -> Path:
    path = tmp_path / "2024YR4.ke0"
    path.write_text(YR4)
    return path


@pytest.fixture
def apollo(tmp_path: Path) -> Path:
    path = tmp_path / "1862.fel"
    path.write_text(APOLLO)
    return path


def sbdb_answer() -> dict[str, Any]:
    """JPL's SBDB, (54509) YORP, solution 2003-01-16 epoch, elements rounded; a covariance of the same size."""
    sigma = {"e": 1e-7, "q": 1e-7, "tp": 3e-5, "node": 2e-5, "peri": 3e-5, "i": 1e-6, "A2": 1.4e-14}
    data = [[repr(a * b * (1.0 if k == l else 0.3)) for l, b in enumerate(sigma.values())]
            for k, a in enumerate(sigma.values())]  # fmt: skip
    elements = [("e", ".2301"), ("q", ".7751"), ("tp", "2452600.123456789012"), ("om", "278.3"), ("w", "278.8"),
                ("i", "1.6")]  # fmt: skip
    return {
        "object": {"fullname": "54509 YORP (2000 PH5)"},
        "orbit": {
            "epoch": "2460000.5",
            "elements": [{"name": "e", "value": ".2"}],
            "model_pars": [{"name": "A2", "value": "-8.72E-14"}, *({"name": n, "value": v} for n, v in
                           (("ALN", "1."), ("NK", "0."), ("NM", "2."), ("R0", "1.")))],
            "covariance": {
                "epoch": "2452655.5",
                "labels": list(sigma),
                "data": data,
                "elements": [{"name": name, "value": value} for name, value in elements],
            },
        },
        "phys_par": [{"name": "H", "value": "22.6"}],
        "signature": {"version": "1.3"},
    }  # fmt: skip


@pytest.fixture
def sbdb(tmp_path: Path) -> Path:
    path = tmp_path / "54509.json"
    path.write_text(json.dumps(sbdb_answer()))
    return path
