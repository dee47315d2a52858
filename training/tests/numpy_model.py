"""Logits of a model with NumPy alone: `numpy_model.py MODEL INPUTS` reads photographs from INPUTS, a
safetensors file of `zero` and `whitened`, (N, 6, side, side), and prints (N, 10, 100) as JSON."""

import json
import struct
import sys

import numpy as np


def safetensors(path):
    """Tensors and metadata of a file of 32-bit floats."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<Q", file.read(8))
        header, data = json.loads(file.read(length)), file.read()
    metadata = header.pop("__metadata__", {})
    tensors = {}
    for name, entry in header.items():
        begin, end = entry["data_offsets"]
        assert entry["dtype"] == "F32", name
        tensors[name] = np.frombuffer(data[begin:end], "<f4").reshape(entry["shape"]).astype(float)
    return tensors, metadata


def trunk(w, x):
    for layer in ("1", "2"):
        kernel = w[f"conv{layer}.weight"]
        windows = np.lib.stride_tricks.sliding_window_view(
            np.pad(x, ((0, 0), (0, 0), (2, 2), (2, 2))), (5, 5), (2, 3)
        )
        x = np.einsum("ncyxij,ocij->noyx", windows, kernel, optimize=True)
        x = np.maximum(x + w[f"conv{layer}.bias"][:, None, None], 0)
        mean, variance, gamma, beta = (
            w[f"norm{layer}.{name}"][:, None, None]
            for name in ("running_mean", "running_var", "weight", "bias")
        )
        x = (x - mean) / np.sqrt(variance + 1e-5) * gamma + beta
        squares = np.pad(x * x, ((0, 0), (2, 2), (0, 0), (0, 0)))
        total = sum(squares[:, i : i + x.shape[1]] for i in range(5))
        x = x / (1 + 1e-4 / 5 * total) ** 0.75
        n, c, h, s = x.shape
        x = x.reshape(n, c, h // 2, 2, s // 2, 2).max((3, 5))
    return x.reshape(len(x), -1)


def head(w, x):
    for layer in ("fc1", "fc2"):
        x = np.maximum(x @ w[f"{layer}.weight"].T + w[f"{layer}.bias"], 0)
    x = x @ w["out.weight"].T + w["out.bias"]
    return x.reshape(len(x), -1, 100)


def softmax(logits):
    exponentials = np.exp(logits - logits.max(2, keepdims=True))
    return exponentials / exponentials.sum(2, keepdims=True)


def below(weights, prefix):
    return {name[len(prefix) :]: w for name, w in weights.items() if name.startswith(prefix)}


def main():
    weights, metadata = safetensors(sys.argv[1])
    inputs, _ = safetensors(sys.argv[2])
    variant = json.loads(metadata["brdfarm"])["training"]["variant"]
    f = [trunk(below(weights, f"{name}."), inputs[key]) if f"{name}.conv1.weight" in weights else None
         for name, key in (("trunk0", "zero"), ("trunkw", "whitened"))]
    if variant != "nested":
        logits = head(below(weights, "heads.0."), np.concatenate([x for x in f if x is not None], 1))
    else:
        logits = np.zeros((len(f[0]), 0, 100))
        for block in range(5):
            told = softmax(logits).reshape(len(logits), -1)
            read = np.concatenate([f[1] if block < 2 else f[0], told], 1)
            logits = np.concatenate([logits, head(below(weights, f"heads.{block}."), read)], 1)
    print(json.dumps(logits.tolist()))


main()
