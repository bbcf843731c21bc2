"""`nebosvod elements`: the orbital elements of an orbit at any date, with sigmas."""

import click

from nebosvod.commands import completion


@click.command()
@click.argument("orbit", shell_complete=completion.orbits)
@click.option("--at", "at", help="Date, UTC unless it says TDB; the orbit's own epoch when absent.")
@click.option("--json", "as_json", is_flag=True, help="Print them as JSON, and nothing else, on stdout.")
def elements(orbit: str, at: str | None, as_json: bool) -> int:
    """Osculating elements of ORBIT on the ecliptic of J2000, carried to a date with their sigmas.

    ORBIT has a covariance: the folder of a fit or a run, a mission, SBDB JSON (cov=mat), .ke0 .ke1 .eq0 .fel,
    mpc_orb.json, or an OEM.

    \b
    Example:  nebosvod elements 2023DW-fit --at 2029-01-01
    """
    import math

    import numpy as np

    from nebosvod.dynamics import Ephemeris
    from nebosvod.dynamics.impact import carry
    from nebosvod.errors import InputError
    from nebosvod.fits.orbit import ELEMENTS, KEPLERIAN, OrbitAt
    from nebosvod.mission.fields import observation_time
    from nebosvod.results.result import json_text
    from nebosvod.scene.orbit import read_orbit

    given = read_orbit(orbit)
    forces = given.forces(Ephemeris.load())
    try:
        epoch = given.epoch if at is None else observation_time(at)
    except InputError as error:
        raise InputError(f"--at: {error}") from None
    there = carry(given.state, given.epoch, epoch, forces, sensitivities=True)
    S = np.hstack([there.Phi[0], there.zeta[0]]) @ given.factor
    found = OrbitAt(
        epoch=epoch, state=np.array(there.state[0]), S=S, S_formal=S, gm_sun_km3_s2=forces.ephemeris.gm_km3_s2["sun"]
    )
    rows = []
    for names, pair in ((KEPLERIAN, found.keplerian()), (ELEMENTS, found.cometary())):
        if pair is not None:
            sigma = np.linalg.norm(pair[1], axis=1)
            rows += [(name, float(v), float(s)) for name, v, s in zip(names, pair[0], sigma)]
    once = {name: {"value": value, "sigma": sigma} for name, value, sigma in rows}
    if as_json:
        click.echo(json_text({"name": given.name, "epoch_tdb": epoch.iso(), "elements": once}), nl=False)
        return 0
    click.echo(f"{given.name}: elements on the ecliptic of J2000 at {epoch.iso()} ({given.origin})")
    for name, row in once.items():
        decimals = min(max(1 - math.floor(math.log10(row["sigma"])), 0), 15)
        click.echo(f"  {name:<18} {row['value']:>22.{decimals}f}  +- {row['sigma']:.2g}")
    for notice in given.notices:
        click.echo(f"notice: {notice}", err=True)
    return 0
