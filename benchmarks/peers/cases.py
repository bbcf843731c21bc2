"""Orbits that the kernels were not tuned on, and how a call is timed.

JPL Horizons, osculating heliocentric states, ecliptic of J2000, au and au/d, all started on 2020-01-01 as if that were
their epoch. Apophis is JPL's solution 220 carried back to that day: ten years take it through its encounter with the
Earth in 2029.
"""

import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import AU_KM, DAY_S
from nebosvod.dynamics.frames import R_icrf_from_ecliptic
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
YEAR_D = 365.25
EPOCH = Epoch.parse("2020-01-01T00:00:00 TDB")
T0_D = EPOCH.jd_tdb - 2451545.0
A123 = (5.0e-13, -2.9e-14, 1.0e-14)  # au/d^2, on every orbit
OBJECTS = {
    "2020 AV2, Vatira": (0.2184969861, -0.4881653318, -0.1450698595, 0.0225265742, 0.0052200792, 0.0007255528),
    "163693 Atira": (0.2888849037, -0.4697682432, -0.0803139775, 0.0159109646, 0.0178844654, -0.0094676550),
    "2010 TK7, Aten": (-0.3965125448, -0.9026620354, 0.1894055706, 0.0129679523, -0.0102667058, -0.0044722120),
    "3753 Cruithne, Aten": (1.4435057326, -0.1322395144, -0.3911536614, -0.0008129821, 0.0096749312, -0.0018237438),
    "54509 YORP, Apollo": (0.4595740490, 1.0134960777, 0.0210748357, -0.0149692214, 0.0033983650, -0.0004464174),
    "2063 Bacchus, Apollo": (0.5193396532, -1.2699971467, -0.2238597167, 0.0101756369, 0.0069015764, 0.0000373904),
    "1221 Amor": (-1.1022748146, 0.2812504271, -0.0235292260, -0.0015204353, -0.0187066051, 0.0039277641),
    "433 Eros, Amor": (0.3739742611, 1.1442467113, 0.1826889728, -0.0164008907, 0.0030043983, -0.0022638951),
    "434 Hungaria": (-2.0098968100, 0.1237429774, 0.0166820555, 0.0001295119, -0.0110034695, 0.0045406533),
    "10297, main belt": (2.1177867197, -1.1299040066, -0.5616444423, 0.0059636106, 0.0092442959, 0.0010023515),
    "911 Agamemnon, Trojan": (0.1419517999, -5.2255201699, -1.9131145815, 0.0070055181, 0.0000676432, 0.0010722759),
    "5335 Damocles, e = 0.87": (0.2943355124, -2.7264547163, -3.1565234243, 0.0060178864, -0.0084690594, -0.0029444316),
    "99942 Apophis": (0.2726129132, 0.8841733773, -0.0405962383, -0.0157241240, 0.0083876978, -0.0008202311),
    "1I, hyperbolic, retrograde": (1.8891361865, 0.6815829717, 0.2590651707, 0.0210650229, 0.0039037822, 0.0081154682),
}


def start_km(name: str) -> Array:
    """Heliocentric ICRF state (6,) of an object at EPOCH, km and km/s."""
    x = np.array(OBJECTS[name])
    return np.concatenate([R_icrf_from_ecliptic @ x[:3] * AU_KM, R_icrf_from_ecliptic @ x[3:] * AU_KM / DAY_S])


def best_ms(call: Callable[[], object], repeats: int) -> float:
    """CPU time of a call, the best of some: other work on the machine only adds to it."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)
