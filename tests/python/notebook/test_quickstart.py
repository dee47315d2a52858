"""The notebook is run from its first cell to its last."""

import os
from pathlib import Path

import nbclient
import nbformat

QUICKSTART = Path(__file__).parents[3] / "examples" / "quickstart.ipynb"


def test_quickstart(tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    notebook = nbformat.read(QUICKSTART, as_version=4)
    nbformat.validate(notebook)
    try:
        import torch.utils.data  # noqa: F401
    except ImportError:
        # The last cells need PyTorch, which is too large for every test: tests/python.sh has it.
        notebook.cells = [cell for cell in notebook.cells if "torch" not in cell.metadata.get("tags", [])]
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) >= 3
    assert not [output for output in outputs if output.output_type == "error"]
    if folder := os.environ.get("BRDFARM_NOTEBOOK_OUT"):
        nbformat.write(notebook, Path(folder) / "quickstart.ipynb")
