"""Loaders of PyTorch over a store: in one process, in workers that forked, in workers spawned."""

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

import brdfarm


@pytest.mark.parametrize(("workers", "method"), [(0, None), (4, "fork"), (4, "spawn")])
@pytest.mark.parametrize("rectified", [None, 16])
def test_loaders(store, spec, workers, method, rectified):
    data = brdfarm.Dataset(store)
    pairs = data.torch(views=(1, 2), rectified=rectified)
    loader = DataLoader(pairs, batch_size=2, num_workers=workers, multiprocessing_context=method)
    batches = list(loader)
    pixels = torch.cat([batch[0] for batch in batches])
    labels = torch.cat([batch[1] for batch in batches])
    height, width = (20, 24) if rectified is None else (16, 16)
    assert pixels.shape == (4, 2, 3, height, width) and pixels.dtype == torch.float32
    assert labels.shape == (4, 10)
    for number, material in enumerate(data.materials):
        image = data[material, 2].pixels if rectified is None else data.rectified(material, 2, 16)
        assert np.array_equal(pixels[number, 1].numpy(), image.transpose(2, 0, 1))
        assert np.allclose(labels[number].numpy(), data.label(material), rtol=1e-6)


def test_workers_that_forked_render(store, spec):
    class Rendered(torch.utils.data.Dataset):
        def __len__(self):
            return 4

        def __getitem__(self, index):
            return torch.from_numpy(brdfarm.render(spec, spec.material(index), 1).pixels)

    # The parent has rendered, and its threads are not in the children.
    expected = torch.stack([Rendered()[index] for index in range(4)])
    found = torch.cat(list(DataLoader(Rendered(), num_workers=2, multiprocessing_context="fork")))
    assert torch.equal(found, expected)


def test_splits_and_what_is_missing(store):
    data = brdfarm.Dataset(store)
    splits = ("train", "validation", "test")
    counts = [len(data.torch(split=split, views=(0,))) for split in splits]
    assert sum(counts) == 4 and counts[0] >= 2
    assert len(data.torch(views=(0, 13))) == 0
    with pytest.raises(ValueError, match="no split"):
        data.torch(split="training")
