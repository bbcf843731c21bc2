"""What a mission resolves to, in words: the output of `nebosvod check`. Loads nothing heavy."""

from nebosvod.mission import Mission, estimate_cost

DEG = 57.29577951308232
ARCSEC = 206264.80624709636


def describe(mission: Mission) -> str:
    """The mission as understood: object, telescopes, schedule, estimators, predictions, cost."""
    lines = [
        f"{mission.name}: {mission.title or mission.name}",
        f"reference epoch  {mission.reference_epoch}",
        f"object           {mission.object.name}; orbit: {mission.object.orbit.kind} at {mission.object.orbit.epoch}",
    ]
    for p in mission.parameters:
        sigma = "" if p.sigma is None else f" +- {p.sigma:.4g}"
        lines.append(f"  {p.name:<18} {p.value:.6g}{sigma}, {p.treatment}")
    lines += [f"  ({statement})" for statement in mission.object.statements]
    for telescope in mission.telescopes:
        ra, dec = (sigma * ARCSEC for sigma in telescope.noise.sigma_rad)
        noise = f"{ra:.3g} arcsec" if ra == dec else f"{ra:.3g} x {dec:.3g} arcsec"
        lines.append(
            f"telescope        {telescope.name}: {telescope.orbit.kind}, noise {noise}"
            + _errors(mission, telescope.name)
        )
    for arc in mission.schedule:
        who = "all telescopes" if arc.telescopes == "all" else ", ".join(arc.telescopes)
        lines.append(f"schedule         {who}: {arc.start} to {arc.end}, {arc.count} epochs")
    lines.append(f"prior orbit      {_prior(mission)}")
    for estimator in mission.estimators:
        changed = "".join(f", {group} {how}" for group, how in estimator.treatment.items())
        lines.append(f"estimator        {estimator.name}: {estimator.method}{changed}")
    for prediction in mission.predictions:
        lines.append(f"prediction       {prediction.name}: {prediction.plane} at {prediction.when}")
    lines += [f"cost             {estimate_cost(mission)}", "the mission is valid; nothing was run"]
    return "\n".join(lines)


def _errors(mission: Mission, name: str) -> str:
    """Bias and position error of a telescope in words."""
    telescope, said = mission.telescope(name), ""
    if telescope.bias is not None:
        pair = telescope.bias.sigma_rad
        size = "no prior" if pair is None else f"{pair[0] * ARCSEC:.3g} arcsec"
        said += f", bias {size} ({telescope.bias.treatment})"
    if telescope.position is not None:
        kind = telescope.position.correlation.replace("_", "-")
        said += f", position {telescope.position.sigma_km[0]:.3g} km {kind} ({telescope.position.treatment})"
    return said


def _prior(mission: Mission) -> str:
    """The prior orbit in words."""
    if isinstance(mission.prior, str):
        return "none" if mission.prior == "none" else "the covariance that came with the orbit"
    if mission.prior.sigma is not None:
        return f"{mission.prior.sigma.position:.4g} km and {mission.prior.sigma.velocity * 1000:.4g} m/s on each axis"
    return "a covariance of " + " ".join(mission.prior.names or ())
