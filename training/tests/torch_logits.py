"""Writes what PyTorch says of the models in a folder: `torch_logits.py DIR OUT`."""

import json
import sys
from pathlib import Path

import torch
from safetensors.torch import load_file

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import model as twin

for path in sorted(Path(sys.argv[1]).glob("*.inputs.safetensors")):
    name = path.name.removesuffix(".inputs.safetensors")
    estimator, _ = twin.load(path.with_name(f"{name}.safetensors"))
    inputs = load_file(path)
    with torch.no_grad():
        logits = estimator([inputs.get("zero"), inputs.get("whitened")])
    rounded = [[[round(value, 6) for value in row] for row in rows] for rows in logits.tolist()]
    (Path(sys.argv[2]) / f"logits-{name}.json").write_text(json.dumps(rounded) + "\n")
