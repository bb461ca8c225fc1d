"""The notebook runs as it stands, with fewer evaluations, and is committed with its outputs."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_calibration.ipynb"


@pytest.fixture
def notebook():
    return nbformat.read(NOTEBOOK, as_version=4)


def test_it_is_committed_with_its_outputs_and_no_path_of_a_machine(notebook):
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert sum(bool(cell.outputs) for cell in code) == len(code)
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert all(word in text for word in ("video/mp4", "image/png", "known"))
    assert not any(place in text for place in ("/work/", "/home/", "/tmp/"))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_cell_runs(notebook, tmp_path):
    cell = next(cell for cell in notebook.cells if "budget=" in cell.source)
    assert "budget=60" in cell.source
    cell.source = cell.source.replace("budget=60", "budget=8")
    nbclient.NotebookClient(notebook, timeout=500, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not any(output.output_type == "error" for output in shown)
