"""The names of the stage are shown before they are loaded."""

import subprocess
import sys

import nebosvod.dynamics


def test_tab_completion_shows_every_public_name_and_no_helper() -> None:
    shown = [name for name in dir(nebosvod.dynamics) if not name.startswith("__")]
    assert set(nebosvod.dynamics.__all__) <= set(shown)
    assert not {"Any", "TYPE_CHECKING", "import_module", "ModuleType", "_HOME"} & set(shown)
    assert all(hasattr(nebosvod.dynamics, name) for name in shown)


def test_looking_at_the_names_does_not_load_the_compiler() -> None:
    looked = "'propagate' in dir(d), '__doc__' in dir(d), 'numba' in sys.modules"
    program = f"import sys, nebosvod.dynamics as d; print({looked})"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["True", "True", "False"]
