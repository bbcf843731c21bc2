"""`nebosvod init`, `missions`, `schema`: what one starts from."""

import json
from pathlib import Path

import click

from nebosvod.errors import InputError


@click.command()
@click.argument("path", type=click.Path(path_type=Path))
def init(path: Path) -> int:
    """Write a commented mission to PATH (a new .yaml file) to start from."""
    from nebosvod.borders.wholefile import write_new_text
    from nebosvod.mission import template_text

    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a mission file ends in .yaml; try: nebosvod init {path}.yaml")
    write_new_text(path, template_text(path.stem))
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
def schema(of_fit: bool, of_study: bool) -> int:
    """Print the JSON Schema of the mission file."""
    from nebosvod.mission.reading.schema import fit_schema, mission_schema

    if of_fit and of_study:
        raise InputError("--fit and --study: one file at a time")
    if of_study:
        from nebosvod.studies.question import study_schema

        made = study_schema()
    else:
        made = fit_schema() if of_fit else mission_schema()
    click.echo(json.dumps(made, indent=2, ensure_ascii=False))
    return 0
