"""Notebooks of the examples run from top to bottom in a kernel of their own, and show what a reader is to see."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed: pip install 'nebosvod[test]'")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install 'nebosvod[test]'")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")  # of the machinery of kernels
def test_a_notebook_runs_and_shows_pictures_and_answers(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert [one.output_type for one in shown if one.output_type not in ("execute_result", "display_data")] == []
    figures = [one for one in shown if "image/png" in one.data]
    answers = [one for one in shown if "<img alt=" in one.data.get("text/html", "")]
    assert len(figures) == 3
    assert len(answers) == 1
    assert all(len(one.data["text/plain"]) < 1000 for one in shown)
    assert list(tmp_path.iterdir()) == []  # nothing is written that was not asked for


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert [cell for cell in notebook.cells if cell.get("outputs") or cell.get("execution_count")] == []
