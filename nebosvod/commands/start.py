"""`nebosvod init`, `missions`, `schema`: what one starts from."""

import json
from pathlib import Path

import click

from nebosvod.commands import completion
from nebosvod.errors import InputError

ANSWERS = {  # whose answer -> the package and file of its JSON Schema
    "run": ("nebosvod.results", "summary.schema.json"),
    "fit": ("nebosvod.results", "fit_summary.schema.json"),
    "ephemeris": ("nebosvod.results", "ephemeris.schema.json"),
    "approaches": ("nebosvod.results", "approaches.schema.json"),
    "alert": ("nebosvod.results", "alert.schema.json"),
    "risk": ("nebosvod.results", "risk.schema.json"),
    "compare": ("nebosvod.results", "comparison.schema.json"),
    "compare-orbits": ("nebosvod.results", "orbit_comparison.schema.json"),
    "plan": ("nebosvod.planning", "plan.schema.json"),
    "decision": ("nebosvod.planning", "decision.schema.json"),
    "study": ("nebosvod.studies", "study.schema.json"),
    "validate": ("nebosvod.studies", "validation.schema.json"),
}


@click.command()
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--from", "source", shell_complete=completion.missions, help="A mission to copy: built-in, or a file.")
def init(path: Path, source: str | None) -> int:
    """Write a commented mission to PATH (a new .yaml file) to start from.

    \b
    Example:  nebosvod init my.yaml
    Example:  nebosvod init my.yaml --from apophis-2029
    """
    from nebosvod.borders.wholefile import write_new_text
    from nebosvod.mission import template_text
    from nebosvod.mission.reading.copying import copied_text

    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a mission file ends in .yaml; try: nebosvod init {path}.yaml")
    text = template_text(path.stem) if source is None else copied_text(source, path)
    write_new_text(path, text)
    click.echo(f"wrote {path}\nnext: edit it, then  nebosvod check {path}  and  nebosvod run {path}")
    return 0


@click.command()
def missions() -> int:
    """List the built-in missions."""
    from nebosvod.mission import list_missions

    rows = list_missions()
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:<{width}}  {title}")
    return 0


@click.command()
@click.option("--fit", "of_fit", is_flag=True, help="Of a file for nebosvod fit.")
@click.option("--study", "of_study", is_flag=True, help="Of a file for nebosvod study.")
@click.option(
    "--answer", type=click.Choice(sorted(ANSWERS)), help="Of summary.json, or of what --json prints, by the command."
)
def schema(of_fit: bool, of_study: bool, answer: str | None) -> int:
    """Print the JSON Schema of the mission file, of the file of a fit or a study, or of an answer."""
    from importlib.resources import files

    from nebosvod.mission.reading.schema import fit_schema, mission_schema

    if of_fit + of_study + (answer is not None) > 1:
        raise InputError("--fit, --study and --answer: one file at a time")
    if answer is not None:
        room, name = ANSWERS[answer]
        click.echo(files(room).joinpath(name).read_text("utf-8"), nl=False)
        return 0
    if of_study:
        from nebosvod.studies.file import study_schema

        made = study_schema()
    else:
        made = fit_schema() if of_fit else mission_schema()
    click.echo(json.dumps(made, indent=2, ensure_ascii=False))
    return 0
