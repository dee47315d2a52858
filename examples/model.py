#!/usr/bin/env python3
"""A model of `brdfarm train` in PyTorch: the same networks, read from model.safetensors.

    python model.py model.safetensors

prints what the model is. From a program:

    estimator, options = load("model.safetensors")
    logits = estimator(photographs(pixels, options))     # (N, 10, 100)
    values = read(logits.softmax(2), options)            # (N, 10), in the units of options["ranges"]

`pixels` are linear, in units of white, (N, 2, side, side, 3): the oblique photograph first, as
`load.py` yields them. Needs torch, numpy and safetensors.
"""

import json
import math
import sys

import numpy as np
import torch
from safetensors import safe_open
from torch import nn

BINS = 100


class Trunk(nn.Module):
    """Two photographs, (N, 6, side, side), to features."""

    def __init__(self, filters):
        super().__init__()
        first, second = filters
        self.conv1, self.norm1 = nn.Conv2d(6, first, 5, padding=2), nn.BatchNorm2d(first)
        self.conv2, self.norm2 = nn.Conv2d(first, second, 5, padding=2), nn.BatchNorm2d(second)
        self.respond, self.pool = nn.LocalResponseNorm(5), nn.MaxPool2d(2)
        self.dropout = nn.Dropout(0.25)

    def forward(self, x):
        for convolution, norm in ((self.conv1, self.norm1), (self.conv2, self.norm2)):
            x = self.dropout(self.pool(self.respond(norm(torch.relu(convolution(x))))))
        return x.flatten(1)


class Head(nn.Module):
    """Features to logits, (N, parameters x 100)."""

    def __init__(self, inputs, hidden, parameters):
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(inputs, hidden[0]), nn.Linear(hidden[0], hidden[1])
        self.out, self.dropout = nn.Linear(hidden[1], parameters * BINS), nn.Dropout(0.25)

    def forward(self, x):
        for layer in (self.fc1, self.fc2):
            x = self.dropout(torch.relu(layer(x)))
        return self.out(x)


def plan(variant):
    """Trunks (CNN_0, CNN_w), and each head's (features of both, given, told) parameters."""
    every = list(range(10))
    whole = {"cnn0": (True, False), "weights": (True, False), "cnnw": (False, True), "flat": (True, True)}
    if variant in whole:
        return whole[variant], [(whole[variant], [], every)]
    told = [[0], [1, 2], [3], [4, 5, 6], [7, 8, 9]]
    given = [every[: names[0]] if variant == "nested" else [] for names in told]
    features = [(block >= 2, block < 2) for block in range(5)]
    return (True, True), list(zip(features, given, told))


class Estimator(nn.Module):
    """All networks of a variant."""

    def __init__(self, variant, architecture):
        super().__init__()
        side, filters, hidden = (architecture[key] for key in ("side", "filters", "hidden"))
        trunks, self.heads_plan = plan(variant)
        self.trunk0, self.trunkw = (Trunk(filters) if there else None for there in trunks)
        length = filters[1] * (side // 4) ** 2
        self.heads = nn.ModuleList(
            Head(sum(features) * length + len(given) * BINS, hidden, len(told))
            for features, given, told in self.heads_plan
        )

    def forward(self, photographs):
        """Photographs as CNN_0 and as CNN_w read them, to logits, (N, 10, 100)."""
        trunks = (self.trunk0, self.trunkw)
        found = [trunk(x) if trunk else None for trunk, x in zip(trunks, photographs)]
        logits = {}
        for (features, given, told), head in zip(self.heads_plan, self.heads):
            inputs = [feature for feature, wanted in zip(found, features) if wanted]
            inputs += [logits[parameter].softmax(1) for parameter in given]
            told_logits = head(torch.cat(inputs, 1)).unflatten(1, (len(told), BINS))
            logits.update({parameter: told_logits[:, i] for i, parameter in enumerate(told)})
        return torch.stack([logits[parameter] for parameter in range(10)], 1)


def load(path):
    """The estimator, ready to be applied, and its options."""
    with safe_open(path, "pt") as file:
        options = json.loads(file.metadata()["brdfarm"])
        weights = {name: file.get_tensor(name) for name in file.keys()}
    training = options["training"]
    estimator = Estimator(training["variant"], training["architecture"])
    lacking, unknown = estimator.load_state_dict(weights, strict=False)
    # PyTorch counts batches; nothing else may be missing.
    if unknown or any("num_batches_tracked" not in name for name in lacking):
        raise ValueError(f"{path}: missing {lacking}, unknown {unknown}")
    return estimator.eval(), options


def encode(pixels, encoding):
    """Linear pixels as codes: white is 1."""
    if encoding == "log":
        return np.log1p(1000 * np.maximum(pixels, 0)) / np.log1p(1000)
    pixels = np.clip(pixels, 0, 1)
    return np.where(pixels <= 0.0031308, 12.92 * pixels, 1.055 * pixels ** (1 / 2.4) - 0.055)


def normalise(codes, normalisation):
    """Codes (N, 6, side, side) as a CNN reads them."""
    if normalisation == "whitened_by_image":
        raise NotImplementedError("--whiten image: each photograph has a whitening of its own")
    if "channels" in normalisation:
        mean, deviation = (
            np.reshape(normalisation["channels"][key], (1, 6, 1, 1)) for key in ("mean", "deviation")
        )
        return (codes - mean) / deviation
    mean, matrix = (np.array(normalisation["whitened"][key]) for key in ("mean", "matrix"))
    views = codes.reshape(len(codes), 2, 3, *codes.shape[2:]) - mean.reshape(3, 1, 1)
    return np.einsum("ij,nvjhw->nvihw", matrix, views).reshape(codes.shape)


def photographs(pixels, options):
    """Linear pixels (N, 2, side, side, 3) as CNN_0 and as CNN_w read them; None for one not there."""
    planes = np.moveaxis(np.asarray(pixels, float), -1, 2)
    planes = planes.reshape(len(planes), 6, *planes.shape[3:])
    codes = encode(planes, options["training"]["encoding"])
    return [
        None if way is None else torch.tensor(normalise(codes, way), dtype=torch.float32)
        for way in options["normalisations"]
    ]


def read(probabilities, options):
    """Mean values of distributions over bins, (N, 10, 100) to (N, 10); psi's mean is circular."""
    positions = torch.arange(BINS) + 0.5
    turns = 2 * math.pi * positions / BINS
    fraction = (probabilities * positions).sum(2) / BINS
    psi = probabilities[:, 2]
    angle = torch.atan2((psi * turns.sin()).sum(1), (psi * turns.cos()).sum(1))
    fraction[:, 2] = (angle / (2 * math.pi)) % 1
    low, high = torch.tensor(ranges(options["training"]["colours"])).T
    return low + (high - low) * fraction


def ranges(colours):
    """The range of each parameter: R in percent, A, psi in degrees, N_d, and two colours."""
    colour = [[0, 1]] * 3 if colours == "rgb" else [[0, 100], [-87, 99], [-108, 95]]
    return np.array([[0, 100], [0, 1], [0, 180], [1, 10], *colour, *colour], dtype=np.float32)


if __name__ == "__main__":
    network, told = load(sys.argv[1])
    count = sum(weight.numel() for weight in network.parameters())
    training = told["training"]
    print(f"{training['variant']}, preset {training['preset']}: {count} weights")
