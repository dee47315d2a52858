"""A dataset for PyTorch's loaders."""

from __future__ import annotations

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset

from brdfarm._dataset import Dataset


class Pairs(TorchDataset):
    """The views of each material, and its ten parameters. Can be read by workers that were forked or
    spawned."""

    def __init__(
        self, dataset: Dataset, materials: list[int], views: tuple[int, ...], rectified: int | None
    ) -> None:
        self.dataset = dataset
        self.materials = materials
        self.views = views
        self.rectified = rectified

    def __len__(self) -> int:
        return len(self.materials)

    def __getitem__(self, number: int) -> tuple[torch.Tensor, torch.Tensor]:
        material = self.materials[number]
        if self.rectified is None:
            images = [self.dataset[material, view].pixels for view in self.views]
        else:
            images = [self.dataset.rectified(material, view, self.rectified) for view in self.views]
        pixels = np.stack(images).transpose(0, 3, 1, 2)
        label = self.dataset.label(material).astype(np.float32)
        return torch.from_numpy(np.ascontiguousarray(pixels)), torch.from_numpy(label)
